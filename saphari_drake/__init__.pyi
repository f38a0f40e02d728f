from .robots.attached import ModelOptions as ModelOptions
from .robots.attached import Payload as Payload
from .robots.attached import Tool as Tool
from .robots.catalog import load as load
from .robots.catalog import lwr4 as lwr4
from .robots.catalog import omnirob as omnirob
from .robots.catalog import planar_6r as planar_6r
from .robots.corrections import RobotCorrections as RobotCorrections
from .robots.corrections import corrected as corrected
from .robots.dynamics import (
    DynamicsTerms as DynamicsTerms,
)
from .robots.dynamics import (
    RobotDynamics as RobotDynamics,
)
from .robots.dynamics import (
    evaluate_dynamics as evaluate_dynamics,
)
from .robots.model import RobotModel as RobotModel

__version__: str
