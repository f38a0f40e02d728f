from .command_switch import CommandSwitch as CommandSwitch
from .command_switch import CommandSwitchParameters as CommandSwitchParameters
from .contact_detector import ContactDetector as ContactDetector
from .contact_detector import ContactDetectorParameters as ContactDetectorParameters
from .contact_monitor import ContactMonitor as ContactMonitor
from .contact_monitor import ContactMonitorParameters as ContactMonitorParameters
from .torque_limit import TorqueLimit as TorqueLimit
