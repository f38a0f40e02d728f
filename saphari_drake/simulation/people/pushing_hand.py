"""A person's hand that reaches for points of the robot and pushes, as a mechanical impedance."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.framework import BasicVector, Context, LeafSystem, State

from saphari_drake.errors import ModelError, ParameterError
from saphari_drake.math.primitives import nearest_surface_point
from saphari_drake.math.rotations import rotation_between
from saphari_drake.messages import Immutable
from saphari_drake.parameters import require_non_negative, require_positive, require_vector, require_within
from saphari_drake.robots.dynamics import evaluate_dynamics
from saphari_drake.robots.model import RobotModel
from saphari_drake.simulation.people.force_recording import STRONGEST
from saphari_drake.simulation.people.hand_law import hand_wrench, retreat, travel
from saphari_drake.simulation.world.hand import HandParameters

Array = NDArray[np.float64]


@dataclass
class Push:
    """One push of the hand."""

    # Name of the link to push.
    link: str = "link_6"
    # m, link frame; the push aims at this point, and touches the surface on the way to it.
    aim: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    # Direction of the push in the world.
    direction: list[float] = field(default_factory=lambda: [0.0, 1.0, 0.0])
    # Direction in which the finger points, in the world; empty: that of the push.
    finger: list[float] = field(default_factory=list)
    # N; the person pushes with no more than this.
    force: float = 30.0
    # s; when the hand starts from its standoff, and how long it pushes from then on.
    start: float = 1.0
    hold: float = 2.0
    # m; the person stops this far past the surface and resists what moves the hand from there. 0: goes on pushing.
    depth: float = 0.0
    # m/s; speed of the hand from its standoff on. 0: that of `HumanHand`.
    speed: float = 0.0
    # N/m and Ns/m; spring and damper of the arm in this push. 0: those of `HandParameters`.
    stiffness: float = 0.0
    damping: float = 0.0

    def __post_init__(self) -> None:
        require_positive(self, "hold")
        require_within(self, 1e-3, STRONGEST, "force")
        require_non_negative(self, "start", "depth", "speed", "stiffness", "damping")
        require_vector(self, 3, "aim", "direction")
        if np.linalg.norm(self.direction) < 1e-9:
            raise ParameterError("direction", "must not be zero")
        if len(self.finger):
            require_vector(self, 3, "finger")


@dataclass(frozen=True)
class Target:
    """Where a push touches the robot, at the posture of the moment."""

    p_WT: Array  # (3,) point on the surface, m
    n_W: Array  # (3,) outward normal
    direction: Array  # (3,) unit direction of the push
    R_WH: Array  # (3, 3) orientation of the hand


def find_target(robot: RobotModel, q: ArrayLike, push: Push) -> Target:
    """Return where a push meets the robot's surface at joint positions `q`, coming from outside.

    Raises
    ------
    ModelError
        If another link is in the way, or the push misses the link.
    """
    link = robot.link_index(push.link)
    terms = evaluate_dynamics(robot, q, np.zeros(robot.n))
    shapes = robot.shapes
    R_WS, p_WS = shapes.in_world(terms.R_WL, terms.p_WL)
    everything = np.ones(shapes.count, dtype=bool)
    direction = np.asarray(push.direction) / np.linalg.norm(push.direction)
    aim = terms.position(link, np.asarray(push.aim))
    p = aim - 1.0 * direction
    for _ in range(200):
        shape, distance, p_WN, n_W = nearest_surface_point(shapes.kind, shapes.size, R_WS, p_WS, everything, p)
        if distance < 1e-5:
            break
        p = p + distance * direction
    if distance >= 1e-5 or np.linalg.norm(p - aim) > 1.0:
        raise ModelError(f"a push along {push.direction} misses {push.link}")
    if shapes.link[shape] != link:
        hit = robot.link_names[shapes.link[shape]] if shapes.link[shape] >= 0 else "the base"
        raise ModelError(f"a push of {push.link} along {push.direction} meets {hit} first")
    finger = np.asarray(push.finger if len(push.finger) else direction, dtype=float)
    return Target(p_WN, n_W, direction, rotation_between(np.array([1.0, 0.0, 0.0]), finger))


@dataclass(frozen=True)
class _Memory(Immutable):
    """State of the person: the push under way, its target, and where the last one was left."""

    index: int
    target: Target
    standoff: Array  # (3,) m, in front of the target
    previous: tuple[Array, Array] | None = None  # standoff and orientation before
    p_release: Array | None = None


class HumanHand(LeafSystem):
    """Moves the hand body along a scripted path through a spring and a damper.

    .. pydrake_system::

        name: HumanHand
        input_ports:
        - hand_state
        - robot_state
        output_ports:
        - generalized_force

    Ports
    -----
    hand_state : 13, from the plant.
    robot_state : 2n, from the plant; the person sees where the robot is when starting to reach.
    generalized_force : nv of the plant, for its applied generalized force.

    Each push goes from a standoff outside the robot towards its target at a steady speed. The spring pulls the hand
    along the push with no more than the push's force, so that it reaches that force and keeps it; across, and when
    coming and going, it is a plain spring and damper. A push with a depth goes no farther than that, so that the hand
    resists like a spring. With `force_profile` the person aims so far into the robot that
    spring and robot balance at that force.

    Parameters
    ----------
    force_profile : callable, optional
        ``force_profile(seconds since the start of the push) -> (3,)`` force in the world (N), or None for the plain
        push.
    robot_stiffness : float
        Stiffness of the robot that the person expects with `force_profile` (N/m).
    """

    STANDOFF = 0.18  # m, from the surface
    SPEED = 0.25  # m/s, towards the surface
    TRAVEL_TIME = 0.9  # s, from one standoff to the next
    RETREAT_TIME = 0.22  # s, from the surface back to the standoff

    def __init__(
        self,
        robot: RobotModel,
        params: HandParameters,
        pushes: Sequence[Push],
        num_velocities: int,
        velocity_start: int,
        force_profile: Callable[[float], Array | None] | None = None,
        robot_stiffness: float = 500.0,
    ) -> None:
        super().__init__()
        if not pushes:
            raise ParameterError("pushes", "needs at least one push")
        self._robot, self._params, self._pushes = robot, params, tuple(pushes)
        self._profile = force_profile
        self._stretch = 1.0 / params.stiffness + 1.0 / robot_stiffness  # m/N, how far the person aims
        self._slice = slice(velocity_start, velocity_start + 6)
        self._num_velocities = num_velocities
        self._hand = self.DeclareVectorInputPort("hand_state", BasicVector(13))
        self._state = self.DeclareVectorInputPort("robot_state", BasicVector(2 * robot.n))
        start = self._reaching(0, robot.home)
        self._compile(start)
        self._memory = self.DeclareAbstractState(AbstractValue.Make(start))
        self.DeclarePeriodicUnrestrictedUpdateEvent(0.005, 0.0, self._update)
        self.DeclareVectorOutputPort(
            "generalized_force",
            BasicVector(num_velocities),
            self._calc,
            prerequisites_of_calc={
                self._hand.ticket(),
                self.time_ticket(),
                self.abstract_state_ticket(self._memory),
            },
        )

    def start_pose(self) -> RigidTransform:
        """Pose of the hand before the first push, at the robot's home posture."""
        start = self._reaching(0, self._robot.home)
        return RigidTransform(RotationMatrix(start.target.R_WH), start.standoff)

    def _compile(self, memory: _Memory) -> None:
        """Compile the law before the first step."""
        previous = replace(memory, previous=(memory.standoff, memory.target.R_WH))
        released = replace(memory, p_release=memory.target.p_WT)
        for case in (previous, released):
            self._wrench(case, self._pushes[0].start - self.TRAVEL_TIME, np.array([1.0, *np.zeros(12)]))

    def _reaching(self, index: int, q: Array, before: _Memory | None = None) -> _Memory:
        """Return the memory of a push that begins at joint positions q (n,)."""
        target = find_target(self._robot, q, self._pushes[index])
        standoff = target.p_WT - target.direction * (self.STANDOFF + self._params.finger_radius)
        return _Memory(index, target, standoff, None if before is None else (before.standoff, before.target.R_WH))

    def _update(self, context: Context, state: State) -> None:
        memory: _Memory = context.get_abstract_state(int(self._memory)).get_value()
        push, time = self._pushes[memory.index], context.get_time()
        value = state.get_mutable_abstract_state(int(self._memory))
        if memory.p_release is None and time >= push.start + push.hold:
            value.set_value(replace(memory, p_release=self._hand.Eval(context)[4:7].copy()))
        following = memory.index + 1
        if following < len(self._pushes) and time >= self._pushes[following].start - self.TRAVEL_TIME:
            q = self._state.Eval(context)[: self._robot.n]
            value.set_value(self._reaching(following, q, memory))

    def _setpoint(self, memory: _Memory, time: float) -> tuple[Array, Array]:
        """Position (3,) and orientation (3, 3) that the person wants the hand to have."""
        push, target = self._pushes[memory.index], memory.target
        standoff, elapsed = memory.standoff, time - push.start
        if memory.p_release is not None:
            return retreat(memory.p_release, standoff, (elapsed - push.hold) / self.RETREAT_TIME), target.R_WH
        if elapsed >= 0.0:
            travelled = self.STANDOFF + (push.depth or self.STANDOFF)
            return standoff + target.direction * min((push.speed or self.SPEED) * elapsed, travelled), target.R_WH
        if memory.previous is None:
            return standoff, target.R_WH
        return travel(*memory.previous, standoff, target.R_WH, 1.0 + elapsed / self.TRAVEL_TIME)

    def _wrench(self, memory: _Memory, time: float, state: Array) -> Array:
        """Torque and force on the hand (6,)."""
        push, params, target = self._pushes[memory.index], self._params, memory.target
        p_set, R_set = self._setpoint(memory, time)
        elapsed, most = time - push.start, np.inf
        stiffness, damping = params.stiffness, params.damping
        if memory.p_release is None and elapsed >= 0.0:
            stiffness, damping = push.stiffness or stiffness, push.damping or damping
            wanted = self._profile(elapsed) if self._profile else None
            if wanted is None:
                most = push.force
            else:
                p_set = target.p_WT + params.finger_radius * target.n_W + self._stretch * wanted
        turn = params.turn_stiffness, params.turn_damping
        return hand_wrench(state, p_set, R_set, target.direction, most, stiffness, damping, *turn)

    def _calc(self, context: Context, output: BasicVector) -> None:
        memory: _Memory = context.get_abstract_state(int(self._memory)).get_value()
        generalized = np.zeros(self._num_velocities)
        generalized[self._slice] = self._wrench(memory, context.get_time(), self._hand.Eval(context))
        output.SetFromVector(generalized)
