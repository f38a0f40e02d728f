from .stability import StabilityWarning as StabilityWarning
from .touch import GuidingPriority as GuidingPriority
from .touch import GuidingStatus as GuidingStatus
