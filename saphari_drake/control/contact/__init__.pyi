from .gate import ForceStatus as ForceStatus
from .law import (
    TorqueTerms as TorqueTerms,
)
from .law import (
    contact_force_torque as contact_force_torque,
)
from .law import (
    contact_impedance_torque as contact_impedance_torque,
)
from .stability import max_hand_stiffness as max_hand_stiffness
