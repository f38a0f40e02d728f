"""Power and force limiting as a system behind whatever commands velocities."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from saphari_drake.messages import ObstaclePoints
from saphari_drake.robots.dynamics import DynamicsTerms, evaluate_dynamics
from saphari_drake.robots.model import RobotModel
from saphari_drake.safety.nearness import NOBODY, Balls, balls_of, surface_of
from saphari_drake.safety.power_force.law import Contact, PowerForceStatus, Rule, contact_scale, heads
from saphari_drake.safety.power_force.parameters import PowerForceParameters, walls_of
from saphari_drake.safety.power_force.regions import limits_of, read_regions
from saphari_drake.systems import declare_cache, declare_readouts

Array = NDArray[np.float64]
_NONE = Contact(1.0, 0.0, np.inf, np.inf, False, -1, -1)
_UNKNOWN = Contact(0.0, np.nan, np.nan, np.nan, False, -1, -1)


class _Output(NamedTuple):
    v: Array
    found: Contact
    status: PowerForceStatus


class PowerForceLimit(LeafSystem):
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
    status : 1, a `PowerForceStatus`; the scale is 0 while people, state or command are not known.

    Law: `contact_scale`. The limits are those of `body_regions.yaml`: check them against a licensed copy of the
    standard. No camera tells the regions apart: the strictest of those that are named counts, and near the top of a
    person no contact is allowed. It has no memory.

    Raises
    ------
    ParameterError, UnknownNameError
        If the regions cannot be read, or one that is named is not there.
    """

    def __init__(self, robot: RobotModel, params: PowerForceParameters | None = None) -> None:
        super().__init__()
        self._params = params or PowerForceParameters()
        p, n = self._params, robot.n
        limits = limits_of(read_regions(p.regions_file), p.regions)
        self._surface = surface_of(robot)
        self._rule = Rule(limits, walls_of(p.structures), p.reach, p.clamp_gap, p.thickest, p.still)
        terms = evaluate_dynamics(robot, robot.home, np.zeros(n))
        self._dynamics = self.DeclareAbstractInputPort("dynamics", AbstractValue.Make(terms))
        self._command = self.DeclareVectorInputPort("velocity_commanded", BasicVector(n))
        self._people = self.DeclareAbstractInputPort("people", AbstractValue.Make(ObstaclePoints()))
        self._scaled(terms, np.zeros(n), NOBODY)  # compiles
        start = _Output(np.zeros(n), _NONE, PowerForceStatus.FREE)
        tickets = {self.all_input_ports_ticket(), self.time_ticket()}
        output = declare_cache(self, "contact", start, self._evaluate, tickets)
        readouts = {
            "velocity_applied": (n, lambda o: o.v),
            "speed_scale": (1, lambda o: [o.found.scale]),
            "energy": (1, lambda o: [o.found.energy]),
            "energy_limit": (1, lambda o: [o.found.limit]),
            "clamped": (1, lambda o: [float(o.found.clamped)]),
            "status": (1, lambda o: [float(o.status)]),
        }
        declare_readouts(self, output, readouts)

    def _scaled(self, terms: DynamicsTerms, v: Array, people: Balls) -> Contact:
        p = self._params
        head = heads(people.p, people.radius, p.head_height, p.person_width)
        return Contact(*contact_scale(self._surface, terms.motion, terms.M, v, people, head, self._rule))

    def _evaluate(self, context: Context) -> _Output:
        terms: DynamicsTerms = self._dynamics.Eval(context)
        v = np.array(self._command.Eval(context))
        if not terms.finite or not np.isfinite(v).all():
            return _Output(np.zeros(len(v)), _UNKNOWN, PowerForceStatus.BAD_INPUT)
        people = NOBODY
        if self._people.HasValue(context):
            points = self._people.Eval(context)
            fresh = context.get_time() - points.stamp <= self._params.people_timeout
            known = balls_of(points) if fresh else None
            if known is None:
                return _Output(0.0 * v, _UNKNOWN, PowerForceStatus.PEOPLE_LOST)
            people = known
        found = self._scaled(terms, v, people)
        limited = PowerForceStatus.LIMITED if found.scale > 0.0 else PowerForceStatus.STOPPED
        return _Output(found.scale * v, found, PowerForceStatus.FREE if found.scale == 1.0 else limited)
