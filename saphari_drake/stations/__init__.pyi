from .follow import Followed as Followed
from .follow import follow as follow
from .parameters import StationParameters as StationParameters
from .ports import StationPorts as StationPorts
from .process import StationProcess as StationProcess
from .shared import StationStatus as StationStatus
from .station import RobotStation as RobotStation
