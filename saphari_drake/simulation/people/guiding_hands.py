"""Two hands that lead a robot: forces over time, or springs whose other end moves, on points of its links."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import AbstractValue, Value
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.plant import ExternallyAppliedSpatialForce, MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.systems.framework import BasicVector, Context, LeafSystem, State

from saphari_drake.errors import ParameterError
from saphari_drake.math.curves import quintic
from saphari_drake.parameters import require_non_negative, require_positive, require_vector
from saphari_drake.robots.model import RobotModel
from saphari_drake.systems import cycle, declare_cache

Array = NDArray[np.float64]
Profile = Callable[[float], Array]


@dataclass
class Pull:
    """One pull or push of a hand."""

    # s; when it begins, how long it lasts, and how long it takes to rise and to fall.
    start: float = 1.0
    duration: float = 2.0
    ramp: float = 0.5
    # N, or m for a hand with stiffness: force, or displacement of the hand, at its height, in the world.
    size: list[float] = field(default_factory=lambda: [0.0, 5.0, 0.0])

    def __post_init__(self) -> None:
        require_non_negative(self, "start")
        require_positive(self, "duration", "ramp")
        if 2.0 * self.ramp > self.duration:
            raise ParameterError("ramp", f"must not exceed half the duration, {0.5 * self.duration} s, got {self.ramp}")
        require_vector(self, 3, "size")

    def share(self, time: float) -> float:
        """Return how much of the pull acts at a time (s), from 0 to 1, with two continuous derivatives."""
        s: float = quintic(min(time - self.start, self.start + self.duration - time) / self.ramp)[0]
        return s


@dataclass
class Hand:
    """A hand at one point of the robot."""

    pulls: list[Pull] = field(default_factory=list)
    # N/m and Ns/m; 0: the pulls are forces, whatever the robot does. Otherwise a spring and damper between the robot
    # and the hand, which takes hold at `hold_from` where the point is then, and moves by the pulls.
    stiffness: float = 0.0
    damping: float = 0.0
    # s; from when to when a hand with stiffness holds on.
    hold_from: float = 0.0
    hold_until: float = np.inf

    def __post_init__(self) -> None:
        require_non_negative(self, "stiffness", "damping", "hold_from")

    def demand(self, time: float) -> Array:
        """Return the sum of the pulls at a time (s), (3,)."""
        total = np.zeros(3)
        for pull in self.pulls:
            total += pull.share(time) * np.asarray(pull.size)
        return total


@dataclass(frozen=True)
class Grip:
    """Where a hand holds the robot.

    Attributes
    ----------
    link : int
        Link of the robot model.
    p_LC : (3,) array
        Point in its frame (m).
    hand : Hand
    profile : callable, optional
        ``profile(time)`` gives a force in the world (N) instead of the hand's pulls.
    """

    link: int
    p_LC: Array
    hand: Hand
    profile: Profile | None = None

    @property
    def stiff(self) -> bool:
        """Whether a spring pulls, not a force."""
        return self.profile is None and self.hand.stiffness > 0.0

    def demand(self, time: float) -> Array:
        """Return what the hand wants at a time (s), (3,): force (N), or displacement (m) of a hand with stiffness."""
        return self.hand.demand(time) if self.profile is None else np.asarray(self.profile(time), dtype=float)


class GuidingHands(LeafSystem):
    """The forces of hands on points of a robot.

    .. pydrake_system::

        name: GuidingHands
        input_ports:
        - state
        output_ports:
        - applied_forces
        - truth

    Ports
    -----
    state : 2n (rad or m, then rad/s or m/s), from the plant.
    applied_forces : abstract list of `ExternallyAppliedSpatialForce`, one a hand that pulls, for the plant and sensors.
    truth : 9 a hand: force on the robot (N), position (m) and velocity (m/s) of the point, world; for judging alone.

    State: where each hand took hold, which only hands with stiffness use.

    Parameters
    ----------
    robot : RobotModel
    plant, instance : MultibodyPlant, ModelInstanceIndex
        Where it is simulated.
    grips : sequence of Grip
    period : float
        How often a hand looks whether to take hold (s).
    """

    def __init__(
        self,
        robot: RobotModel,
        plant: MultibodyPlant,
        instance: ModelInstanceIndex,
        grips: Sequence[Grip],
        period: float = 0.001,
    ) -> None:
        super().__init__()
        self._robot, self._grips = robot, tuple(grips)
        self._bodies = [plant.GetBodyByName(robot.link_names[grip.link], instance).index() for grip in grips]
        self._state = self.DeclareVectorInputPort("state", BasicVector(2 * robot.n))
        self._held = self.DeclareDiscreteState(np.full(3 * len(grips), np.nan))
        tickets = {self._state.ticket(), self.discrete_state_ticket(self._held), self.time_ticket()}
        self._truth = declare_cache(self, "truth", np.zeros((len(grips), 9)), self._evaluate, tickets)
        self.DeclareAbstractOutputPort(
            "applied_forces",
            alloc=lambda: Value[list[ExternallyAppliedSpatialForce]](),
            calc=self._calc_forces,
            prerequisites_of_calc={self._truth.ticket()},
        )
        self.DeclareVectorOutputPort(
            "truth",
            BasicVector(9 * len(grips)),
            lambda context, output: output.SetFromVector(self._truth.Eval(context).ravel()),
            prerequisites_of_calc={self._truth.ticket()},
        )
        self.DeclarePeriodicUnrestrictedUpdateEvent(**cycle(period), update=self._take_hold)

    def _evaluate(self, context: Context) -> Array:
        time, held = context.get_time(), context.get_discrete_state(self._held).value().reshape(-1, 3)
        return grip_forces(self._robot, self._state.Eval(context), self._grips, held, time)

    def _calc_forces(self, context: Context, output: AbstractValue) -> None:
        forces, time = [], context.get_time()
        # Without a spring nothing of the robot is needed.
        stiff = any(grip.stiff for grip in self._grips)
        rows = self._truth.Eval(context) if stiff else [grip.demand(time) for grip in self._grips]
        for body, grip, row in zip(self._bodies, self._grips, rows):
            if not row[:3].any():
                continue
            force = ExternallyAppliedSpatialForce()
            force.body_index = body
            force.p_BoBq_B = grip.p_LC
            force.F_Bq_W = SpatialForce(np.zeros(3), row[:3])
            forces.append(force)
        output.set_value(forces)

    def _take_hold(self, context: Context, state: State) -> None:
        now, held = context.get_time(), context.get_discrete_state(self._held).value().reshape(-1, 3).copy()
        taking = [k for k, grip in enumerate(self._grips) if np.isnan(held[k, 0]) and now >= grip.hand.hold_from]
        if not taking:
            return
        held[taking] = self._truth.Eval(context)[taking, 3:6]
        state.get_mutable_discrete_state(self._held).SetFromVector(held.ravel())


def grip_forces(robot: RobotModel, state: Array, grips: Sequence[Grip], held: Array, time: float) -> Array:
    """Return force (N), position (m) and velocity (m/s) of each grip in the world (k, 9).

    Parameters
    ----------
    robot : RobotModel
    state : (2n,) array
        Joint positions and velocities.
    grips : sequence of Grip
    held : (k, 3) array
        Where each hand took hold (m), NaN before.
    time : float
        In s.
    """
    at = robot.kinematics(state[: robot.n], state[robot.n :])
    rows = np.zeros((len(grips), 9))
    for row, grip, anchor in zip(rows, grips, held):
        p, velocity, _, _ = at.point(grip.link, np.asarray(grip.p_LC, float))
        hand, force = grip.hand, grip.demand(time)
        if grip.stiff:
            holds = np.isfinite(anchor[0]) and hand.hold_from <= time <= hand.hold_until
            pull = hand.stiffness * (anchor + force - p) - hand.damping * velocity
            force = pull if holds else np.zeros(3)
        row[:] = np.concatenate([force, p, velocity])
    return rows
