from .contact.force_system import ContactForceController as ContactForceController
from .contact.parameters import (
    ContactForceControlParameters as ContactForceControlParameters,
)
from .contact.parameters import (
    ContactImpedanceParameters as ContactImpedanceParameters,
)
from .contact.system import ContactImpedanceController as ContactImpedanceController
from .hand_guiding.parameters import (
    GuidedPointParameters as GuidedPointParameters,
)
from .hand_guiding.parameters import (
    HandGuidingParameters as HandGuidingParameters,
)
from .hand_guiding.system import HandGuidingController as HandGuidingController
from .joint_servo import JointServoParameters as JointServoParameters
from .joint_servo import JointVelocityServo as JointVelocityServo
from .nmpc.parameters import NmpcParameters as NmpcParameters
from .nmpc.problem import NmpcProblem as NmpcProblem
from .nmpc.system import NmpcController as NmpcController
from .null_space.parameters import NullSpaceComplianceParameters as NullSpaceComplianceParameters
from .null_space.system import NullSpaceComplianceController as NullSpaceComplianceController
from .reverse_priority.stack import PriorityStack as PriorityStack
from .reverse_priority.system import (
    ReversePriorityController as ReversePriorityController,
)
from .reverse_priority.system import (
    ReversePriorityParameters as ReversePriorityParameters,
)
