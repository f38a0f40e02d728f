"""The verified stop as a system behind whatever commands velocities."""

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import BasicVector, Context, InputPort, LeafSystem, State

from saphari_drake.messages import Immutable, ObstaclePoints, ObstacleStatus
from saphari_drake.robots.model import RobotModel
from saphari_drake.safety.nearness import Balls, balls_of, surface_of
from saphari_drake.safety.power_force.law import Rule, heads
from saphari_drake.safety.power_force.parameters import walls_of
from saphari_drake.safety.power_force.regions import limits_of, read_regions
from saphari_drake.safety.verified_stop.law import Checked, StopStatus, Surroundings, checked_velocity
from saphari_drake.safety.verified_stop.parameters import VerifiedStopParameters, body_of
from saphari_drake.safety.verified_stop.touch import Touch
from saphari_drake.systems import cycle, declare_cache, declare_readouts

Array = NDArray[np.float64]
NOTHING = Surroundings(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0), np.zeros(0))


class _Memory(Immutable):
    def __init__(self, checked: Checked) -> None:
        self.checked = checked


class VerifiedStop(LeafSystem):
    """Passes a joint velocity on for one cycle if a stop exists after it; else carries out the last verified stop.

    .. pydrake_system::

        name: VerifiedStop
        input_ports:
        - position_measured
        - velocity_commanded
        - command_time
        - people
        - things
        output_ports:
        - velocity_applied
        - status
        - margin
        - stop_time

    Ports
    -----
    position_measured : n (rad or m), from a joint sensor.
    velocity_commanded : n (rad/s or m/s), of any source, which need not be trusted.
    command_time : 1 (s), when the command was made; optional: now. One that hangs is noticed by it.
    people : abstract `ObstaclePoints`, optional: nobody. Where they were at their stamp; they may come nearer at once
        with the speed of the parameters, whatever velocities the points have.
    things : abstract `ObstaclePoints`, optional: none. They go on with their velocities.
    velocity_applied : n (rad/s or m/s), for the cycle that begins; at the start zero.
    status : 1, a `StopStatus`.
    margin : 1 (m), least distance left during the stop after the applied velocity, beyond all that is kept; infinite
        where nobody is or the robot stands, NaN while that is not known.
    stop_time : 1 (s), that this stop takes.

    Law and guarantee: `checked_velocity`; which touches are soft: `PowerForceLimit`. The robot stands at the start.
    """

    def __init__(self, robot: RobotModel, params: VerifiedStopParameters | None = None) -> None:
        super().__init__()
        self._params = params or VerifiedStopParameters()
        self.body, self._surface = body_of(robot, self._params), surface_of(robot)
        c = self._params.contact
        limits = limits_of(read_regions(c.regions_file), c.regions)
        self._rule = Rule(limits, walls_of(c.structures), np.inf, c.clamp_gap, c.thickest, c.still)
        n, zero, points = robot.n, np.zeros(robot.n), AbstractValue.Make(ObstaclePoints())
        self._position = self.DeclareVectorInputPort("position_measured", BasicVector(n))
        self._command = self.DeclareVectorInputPort("velocity_commanded", BasicVector(n))
        self._made = self.DeclareVectorInputPort("command_time", BasicVector(1))
        self._people = self.DeclareAbstractInputPort("people", points)
        self._things = self.DeclareAbstractInputPort("things", points)
        rest = Checked(zero, int(StopStatus.PASSING), np.inf, 0.0)
        given = self.body, 1, robot.home, zero, 1e-3 * self.body.v_max, True, NOTHING, self._touch(ObstaclePoints())
        checked_velocity(*given)  # compiles
        self._memory = self.DeclareAbstractState(AbstractValue.Make(_Memory(rest)))
        state = {self.abstract_state_ticket(self._memory)}
        output = declare_cache(self, "checked", rest, lambda context: self._remembered(context), state)
        readouts = {
            "velocity_applied": (n, lambda o: o.v),
            "status": (1, lambda o: [float(o.status)]),
            "margin": (1, lambda o: [o.margin]),
            "stop_time": (1, lambda o: [o.stop_time]),
        }
        declare_readouts(self, output, readouts)
        self.DeclarePeriodicUnrestrictedUpdateEvent(**cycle(self.body.period), update=self._update)

    def _remembered(self, context: Context) -> Checked:
        memory: _Memory = context.get_abstract_state(int(self._memory)).get_value()
        return memory.checked

    def _update(self, context: Context, state: State) -> None:
        q, command = np.array(self._position.Eval(context)), np.array(self._command.Eval(context))
        time, before = context.get_time(), self._remembered(context).v
        fault, around = self._surroundings(context)
        if self._made.HasValue(context):
            made = self._made.Eval(context)[0]
            if not time - made <= self._params.command_timeout:
                fault = StopStatus.STALE
        if not (np.isfinite(q).all() and np.isfinite(command).all()):
            fault = StopStatus.BAD_INPUT
        touch = self._touch(ObstaclePoints())
        if fault is None and self._people.HasValue(context):
            touch = self._touch(self._people.Eval(context))
        if fault is not None:
            q, command = 0.0 * before, 0.0 * before
        checked = Checked(
            *checked_velocity(self.body, self._params.intervals, q, before, command, fault is None, around, touch)
        )
        if fault is not None:
            checked = checked._replace(status=int(fault))
        state.get_mutable_abstract_state(int(self._memory)).set_value(_Memory(checked))

    def _surroundings(self, context: Context) -> tuple[StopStatus | None, Surroundings]:
        """Return what is wrong with people and things, if anything, and both as balls."""
        p, time, parts = self._params, context.get_time(), []
        for port, speed in ((self._people, p.person_speed), (self._things, 0.0)):
            if not port.HasValue(context):
                continue
            points, age = port.Eval(context), port.Eval(context).age(time)
            if points.status == ObstacleStatus.LOST or age > p.people_timeout or not points.usable:
                return StopStatus.OBSTACLES_LOST, NOTHING
            parts.append(self._balls(points, age, port, speed))
        if not parts:
            return None, NOTHING
        return None, Surroundings(*(np.concatenate(column) for column in zip(*parts)))

    def _touch(self, people: ObstaclePoints) -> Touch | None:
        """Return whom the robot may touch: people, who come first in the surroundings, but for their heads."""
        c, seen = self._params.contact, balls_of(people)
        if not self._params.touch or seen is None:
            return None
        which = np.flatnonzero(~heads(seen.p, seen.radius, c.head_height, c.person_width))
        return Touch(self._surface, self._rule, Balls(seen.p[which], seen.v[which], seen.radius[which]), which)

    def _balls(self, points: ObstaclePoints, age: float, port: InputPort, speed: float) -> Surroundings:
        p, count = self._params, len(points.p_WO)
        at, v = np.asarray(points.p_WO, dtype=float), np.asarray(points.v_WO, dtype=float)
        radius = np.asarray(points.radius, dtype=float) + p.tracking_error
        if port is self._people:
            kept = radius + p.person_error + p.separation + speed * age
            return Surroundings(at, np.zeros((count, 3)), kept, np.full(count, speed))
        return Surroundings(at + age * v, v, radius + p.thing_separation, np.zeros(count))
