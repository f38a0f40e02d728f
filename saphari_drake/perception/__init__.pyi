from .camera.check_parameters import CameraCheckParameters as CameraCheckParameters
from .camera.check_system import CameraCheck as CameraCheck
from .camera.check_system import CheckScheduleParameters as CheckScheduleParameters
from .camera.frame_check import FrameCheckParameters as FrameCheckParameters
from .camera.frame_check import FrameStatus as FrameStatus
from .camera.frame_check_system import FrameCheck as FrameCheck
from .camera.model import CameraParameters as CameraParameters
from .contact.localizer import ContactLocalizer as ContactLocalizer
from .contact.parameters import FusionParameters as FusionParameters
from .contact.parameters import LocalizerParameters as LocalizerParameters
from .contact.values import ContactModes as ContactModes
from .obstacles.tracker import ObstacleTracker as ObstacleTracker
from .obstacles.tracks import ObstacleTrackerParameters as ObstacleTrackerParameters
from .segmentation.background import background_depth as background_depth
from .skin.calibration import SkinCalibration as SkinCalibration
from .skin.calibration import calibrate as calibrate
from .skin.estimator import SkinEstimator as SkinEstimator
from .skin.estimator import SkinEstimatorParameters as SkinEstimatorParameters
from .skin.layout import SkinLayout as SkinLayout
from .skin.layout import SkinLayoutParameters as SkinLayoutParameters
from .wrench.estimator import (
    WristWrenchEstimator as WristWrenchEstimator,
)
from .wrench.estimator import (
    WristWrenchParameters as WristWrenchParameters,
)
from .wrench.identification import identify_tool as identify_tool
from .wrench.tool import ToolParameters as ToolParameters
