from .contact_force import (
    ContactForceEstimator as ContactForceEstimator,
)
from .contact_force import (
    ContactForceParameters as ContactForceParameters,
)
from .disturbance_observer import (
    DisturbanceObserver as DisturbanceObserver,
)
from .disturbance_observer import (
    DisturbanceObserverParameters as DisturbanceObserverParameters,
)
from .excitation import Excitation as Excitation
from .excitation import ExcitationParameters as ExcitationParameters
from .excitation import draw_excitation as draw_excitation
from .joint_acceleration import JointAcceleration as JointAcceleration
from .joint_friction import JointFrictionParameters as JointFrictionParameters
from .joint_identification import Identification as Identification
from .joint_identification import identify as identify
from .joint_velocity import JointVelocity as JointVelocity
from .joint_velocity import JointVelocityParameters as JointVelocityParameters
from .model_error import (
    LearningStatus as LearningStatus,
)
from .model_error import (
    ModelErrorEstimator as ModelErrorEstimator,
)
from .model_error import (
    ModelErrorParameters as ModelErrorParameters,
)
from .momentum_observer import (
    MomentumObserver as MomentumObserver,
)
from .momentum_observer import (
    MomentumObserverParameters as MomentumObserverParameters,
)
from .torque_window import TorqueWindow as TorqueWindow
from .torque_window import window_weights as window_weights
from .wrench_check import WrenchCheck as WrenchCheck
from .wrench_check import WrenchCheckParameters as WrenchCheckParameters
from .wrench_check import WrenchCheckStatus as WrenchCheckStatus
