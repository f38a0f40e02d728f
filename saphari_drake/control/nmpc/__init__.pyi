from .law import nmpc_step as nmpc_step
from .parameters import NmpcReference as NmpcReference
from .parameters import NmpcStatus as NmpcStatus
from .parameters import TestPoint as TestPoint
