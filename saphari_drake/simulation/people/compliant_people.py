"""People in a cell who move by themselves, are seen by cameras, and give way where they are touched."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import AbstractValue, Value
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.plant import ExternallyAppliedSpatialForce, MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.systems.framework import BasicVector, Context, LeafSystem, State

from saphari_drake.parameters import require_non_negative, require_positive
from saphari_drake.robots.model import RobotModel
from saphari_drake.safety.nearness import surface_of
from saphari_drake.safety.power_force.regions import read_regions
from saphari_drake.simulation.people.performance import Performance, played
from saphari_drake.simulation.people.skeleton import HANDS, SEGMENTS, PersonSizes, segment_ends
from saphari_drake.simulation.people.touching import Flesh, Touches, given_way, touches
from saphari_drake.systems import cycle, declare_cache, declare_readouts

Array = NDArray[np.float64]
COUNT = len(SEGMENTS)


@dataclass
class PeopleParameters:
    """How people give way, and whether they go for the robot. All assumed but the contact: `body_regions.yaml`."""

    sizes: PersonSizes = field(default_factory=PersonSizes)
    # N/m, with which a person keeps arms and hands, and the rest of the body, where they should be; the ratio of the
    # damping of that.
    arm_stiffness: float = 600.0
    body_stiffness: float = 4000.0
    damping_ratio: float = 1.0
    # s/m, of the contact (Hunt–Crossley).
    dissipation: float = 1.0
    # m/s, with which the right hand of each person goes for the robot's last link, and m, how far at most; 0: not.
    pursuit_speed: float = 0.0
    pursuit_reach: float = 0.5

    def __post_init__(self) -> None:
        require_positive(self, "arm_stiffness", "body_stiffness", "pursuit_reach")
        require_non_negative(self, "damping_ratio", "dissipation", "pursuit_speed")

    def flesh(self, people: int) -> Flesh:
        """Return what the segments of so many people are made of."""
        regions = read_regions()
        own = [regions[segment.region] for segment in SEGMENTS] * people
        mass = np.array([region.mass for region in own])
        arms = [segment.region in ("hand", "forearm", "upper_arm") for segment in SEGMENTS] * people
        hold = np.where(arms, self.arm_stiffness, self.body_stiffness)
        damping = 2.0 * self.damping_ratio * np.sqrt(hold * mass)
        stiffness = np.array([region.stiffness for region in own])
        return Flesh(np.tile(self.sizes.radii(), people), stiffness, mass, hold, damping, self.dissipation)


class CompliantPeople(LeafSystem):
    """People as capsules that move along their performances, and give way by segments where the robot pushes them.

    .. pydrake_system::

        name: CompliantPeople
        input_ports:
        - state
        output_ports:
        - applied_forces
        - ends
        - touch
        - forces
        - gap

    Ports
    -----
    state : 2n (rad or m, then rad/s or m/s), of the robot, from the plant.
    applied_forces : abstract list of `ExternallyAppliedSpatialForce` on the robot, for the plant.
    ends : 6 a segment (m), both ends in the world.
    touch : 8, of the strongest contact: force on the robot (N), point (m, world), link and segment (−1: none).
    forces : 1 a segment (N).
    gap : 1 (m), least distance of the robot from anybody, negative in contact; farther than 0.5 m it is infinite.

    All outputs but the first are the truth, for judging alone. Law: `touches` and `given_way`.

    Parameters
    ----------
    robot : RobotModel
    plant, instance : MultibodyPlant, ModelInstanceIndex
        Where it is simulated.
    people : sequence of Performance
    params : PeopleParameters
    period : float
        Of the plant (s).
    """

    def __init__(
        self,
        robot: RobotModel,
        plant: MultibodyPlant,
        instance: ModelInstanceIndex,
        people: Sequence[Performance],
        params: PeopleParameters | None = None,
        period: float = 0.001,
    ) -> None:
        super().__init__()
        self._robot, self._people, self._period = robot, tuple(people), period
        self._params, self._surface = params or PeopleParameters(), surface_of(robot)
        self._flesh, self._size = self._params.flesh(len(people)), COUNT * len(people)
        self._motions = [segment_ends(person.joints, self._params.sizes) for person in people]
        for motion in self._motions:
            played(motion, 0.0)  # compiles
        self._bodies = [plant.GetBodyByName(name, instance).index() for name in robot.link_names]
        self._state = self.DeclareVectorInputPort("state", BasicVector(2 * robot.n))
        self._aside = self.DeclareDiscreteState(np.zeros(9 * self._size))  # x, v and rest of each segment
        tickets = {self.time_ticket(), self.discrete_state_ticket(self._aside)}
        ends = np.zeros((2, self._size, 2, 3))
        self._ends = declare_cache(self, "ends", ends, self._placed, tickets)
        touched = {self._ends.ticket(), self._state.ticket()}
        self._touches = declare_cache(self, "touches", self._touched(np.tile(robot.home, 2), ends), self._calc, touched)
        self.DeclareAbstractOutputPort(
            "applied_forces",
            alloc=lambda: Value[list[ExternallyAppliedSpatialForce]](),
            calc=self._calc_forces,
            prerequisites_of_calc={self._touches.ticket()},
        )
        declare_readouts(self, self._ends, {"ends": (6 * self._size, lambda pair: pair[0].ravel())})
        readouts = {
            "touch": (8, _strongest),
            "forces": (self._size, lambda t: np.linalg.norm(t.force, axis=1)),
            "gap": (1, lambda t: [t.gap.min()]),
        }
        declare_readouts(self, self._touches, readouts)
        self.DeclarePeriodicUnrestrictedUpdateEvent(**cycle(period), update=self._update)

    def sizes(self) -> list[tuple[float, float]]:
        """Return length, in the median over time, and radius of each segment (m)."""
        lengths = [np.median(np.linalg.norm(ends[:, :, 1] - ends[:, :, 0], axis=2), axis=0) for ends in self._motions]
        return [(float(length), float(radius)) for length, radius in zip(np.concatenate(lengths), self._flesh.radius)]

    def _parts(self, context: Context) -> Array:
        return np.array(context.get_discrete_state(self._aside).value()).reshape(3, self._size, 3)

    def _placed(self, context: Context) -> Array:
        """Return the segments' ends and their velocities (2, k, 2, 3), pushed aside as they are."""
        x, v, _ = self._parts(context)
        out = np.empty((2, self._size, 2, 3))
        for k, (person, samples) in enumerate(zip(self._people, self._motions)):
            rows = slice(COUNT * k, COUNT * (k + 1))
            out[0, rows], out[1, rows] = played(samples, (context.get_time() + person.start) * person.rate)
            out[1, rows] *= person.rate
        out[0] += x[:, None]
        out[1] += v[:, None]
        return out

    def _touched(self, state: Array, ends: Array) -> Touches:
        motion = self._robot.kinematics(state[: self._robot.n], state[self._robot.n :]).motion
        return Touches(*touches(self._surface, motion, ends[0], ends[1], self._flesh))

    def _calc(self, context: Context) -> Touches:
        return self._touched(self._state.Eval(context), self._ends.Eval(context))

    def _calc_forces(self, context: Context, output: AbstractValue) -> None:
        found, forces = self._touches.Eval(context), []
        motion = None
        for k in np.flatnonzero(found.link >= 0):
            motion = motion or self._robot.kinematics(self._state.Eval(context)[: self._robot.n])
            force = ExternallyAppliedSpatialForce()
            force.body_index = self._bodies[found.link[k]]
            force.p_BoBq_B = motion.in_link(found.link[k], found.point[k])
            force.F_Bq_W = SpatialForce(np.zeros(3), found.force[k])
            forces.append(force)
        output.set_value(forces)

    def _update(self, context: Context, state: State) -> None:
        x, v, rest = self._parts(context)
        if self._params.pursuit_speed > 0.0:
            self._pursue(context, rest)
        given_way(x, v, self._touches.Eval(context).force, rest, self._flesh, self._period)
        state.get_mutable_discrete_state(self._aside).SetFromVector(np.stack([x, v, rest]).ravel())

    def _pursue(self, context: Context, rest: Array) -> None:
        """Move where the right hands should be towards the last link."""
        target = self._robot.kinematics(self._state.Eval(context)[: self._robot.n]).p_WL[-1]
        ends = self._ends.Eval(context)[0]
        for person in range(len(self._people)):
            hand = COUNT * person + HANDS[-1]
            way = target - ends[hand, 1]
            step = self._params.pursuit_speed * self._period / max(float(np.linalg.norm(way)), 1e-6)
            rest[hand] += min(step, 1.0) * way
            rest[hand] *= min(1.0, self._params.pursuit_reach / max(float(np.linalg.norm(rest[hand])), 1e-9))


def _strongest(found: Touches) -> Array:
    size = np.linalg.norm(found.force, axis=1)
    k = int(np.argmax(size))
    if size[k] == 0.0:
        return np.array([0.0] * 6 + [-1.0, -1.0])
    return np.array([*found.force[k], *found.point[k], found.link[k], k])
