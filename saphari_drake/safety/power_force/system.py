"""Power and force limiting as a system behind whatever commands velocities."""

import numpy as np
from numpy.typing import NDArray

from saphari_drake.robots.dynamics import DynamicsTerms
from saphari_drake.robots.model import RobotModel
from saphari_drake.safety.nearness import Balls, surface_of
from saphari_drake.safety.power_force.law import Contact, Rule, contact_scale, heads
from saphari_drake.safety.power_force.parameters import PowerForceParameters, walls_of
from saphari_drake.safety.power_force.regions import limits_of, read_regions
from saphari_drake.safety.speed_scale import SpeedScale

Array = NDArray[np.float64]
_UNKNOWN = Contact(0.0, np.nan, np.nan, np.nan, False, -1, -1)


class PowerForceLimit(SpeedScale):
    """Scales a joint velocity so that no contact with a person would be harder than the body allows.

    .. pydrake_system::

        name: PowerForceLimit
        input_ports:
        - dynamics
        - velocity_commanded
        - people
        output_ports:
        - velocity_applied
        - speed_scale
        - energy
        - energy_limit
        - clamped
        - status

    Ports
    -----
    dynamics : abstract `DynamicsTerms`, of the measured state.
    velocity_commanded : n (rad/s or m/s).
    people : abstract `ObstaclePoints`, of cameras; optional: nobody.
    velocity_applied : n (rad/s or m/s), the command times `speed_scale`; a `VelocityEnvelope` comes after it.
    speed_scale : 1, from 0 to 1.
    energy : 1 (J), that the full command would have in the contact nearest to its limit; 0 where none is near.
    energy_limit : 1 (J), of that contact; infinite where none is near.
    clamped : 1, whether the person there could not give way.
    status : 1, a `ScaleStatus`; the scale is 0 while people, state or command are not known.

    Law: `contact_scale`. The limits are those of `body_regions.yaml`: check them against a licensed copy of the
    standard. No camera tells the regions apart: the strictest of those that are named counts, and near the top of a
    person no contact is allowed. It has no memory.

    Raises
    ------
    ParameterError, UnknownNameError
        If the regions cannot be read, or one that is named is not there.
    """

    def __init__(self, robot: RobotModel, params: PowerForceParameters | None = None) -> None:
        self._params = p = params or PowerForceParameters()
        limits = limits_of(read_regions(p.regions_file), p.regions)
        self._surface = surface_of(robot)
        self._rule = Rule(limits, walls_of(p.structures), p.reach, p.clamp_gap, p.thickest, p.still)
        readouts = {
            "energy": (1, lambda found: [found.energy]),
            "energy_limit": (1, lambda found: [found.limit]),
            "clamped": (1, lambda found: [float(found.clamped)]),
        }
        super().__init__(robot, p.people_timeout, _UNKNOWN, readouts)

    def _scaled(self, terms: DynamicsTerms, v: Array, people: Balls, age: float) -> Contact:
        p = self._params
        head = heads(people.p, people.radius, p.head_height, p.person_width)
        return Contact(*contact_scale(self._surface, terms.motion, terms.M, v, people, head, self._rule))
