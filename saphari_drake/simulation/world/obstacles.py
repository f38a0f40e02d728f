"""Things that touch the arm: an elastic ball on a position-controlled carrier, and a wall with a soft pad."""

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import Box, CollisionFilterDeclaration, Cylinder, GeometrySet, Sphere
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import FixedOffsetFrame, PdControllerGains, PrismaticJoint, RigidBody, SpatialInertia
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import TrajectorySource
from pydrake.trajectories import PiecewisePolynomial

from saphari_drake.errors import ParameterError
from saphari_drake.math.primitives import nearest_surface_point
from saphari_drake.parameters import require_non_negative, require_positive
from saphari_drake.robots.dynamics import evaluate_dynamics
from saphari_drake.robots.model import RobotModel
from saphari_drake.simulation.world.cell import Body, Cell
from saphari_drake.simulation.world.plant import point_contact

Array = NDArray[np.float64]
_RUBBER = np.array([0.16, 0.45, 0.70, 1.0])
_PAD = np.array([0.55, 0.65, 0.55, 0.5])
_STEEL = np.array([0.5, 0.5, 0.5, 1.0])
_FAR = 1.0  # m; from where the way of the ball to the arm is searched


@dataclass
class TouchPlace:
    """Where on the arm, and from where. All assumed."""

    # Link whose cover is touched. The covers of neighbours overlap at a joint, where both would push: they do not.
    link: str = "link_3"
    # m; point of the link, in its frame, that the contact is aimed at: here the fourth joint.
    aim: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.2])
    # Direction of the push on the arm, in the world.
    direction: list[float] = field(default_factory=lambda: [0.0, -1.0, 0.0])

    def __post_init__(self) -> None:
        if np.shape(self.aim) != (3,):
            raise ParameterError("aim", f"needs three entries, got {self.aim}")
        if np.shape(self.direction) != (3,) or not np.linalg.norm(self.direction) > 0.0:
            raise ParameterError("direction", f"needs three entries that are not all zero, got {self.direction}")


@dataclass
class BallParameters:
    """Ball and its carrier. Stiffness, speed and dwell: the deliverable; the others assumed."""

    touch: TouchPlace = field(default_factory=TouchPlace)
    # m.
    radius: float = 0.06
    # N/m; of the ball alone: the arm's cover is rigid.
    stiffness: float = 1200.0
    # s/m (Hunt–Crossley), and friction on the cover.
    dissipation: float = 1.0
    friction: float = 0.3
    # s; when the ball starts to move.
    start: float = 1.0
    # m; its distance from the cover before that.
    gap: float = 0.0225
    # m/s.
    speed: float = 0.045
    # m; travel of the carrier after first contact.
    stroke: float = 0.05
    # s; stay at the end of the stroke.
    dwell: float = 10.0
    # kg; moving mass of the carrier; N/m and Ns/m, gains of its position control.
    mass: float = 5.0
    carrier_stiffness: float = 1.0e6
    carrier_damping: float = 5.0e3

    def __post_init__(self) -> None:
        require_positive(
            self, "radius", "stiffness", "start", "gap", "speed", "stroke", "dwell", "mass", "carrier_stiffness",
            "carrier_damping",
        )  # fmt: skip
        require_non_negative(self, "dissipation", "friction")

    @property
    def arrival(self) -> float:
        """Time at which the ball stops (s)."""
        return self.start + (self.gap + self.stroke) / self.speed

    @property
    def departure(self) -> float:
        """Time at which it starts back (s)."""
        return self.arrival + self.dwell


def ball_path(params: BallParameters) -> PiecewisePolynomial:
    """Return how far the carrier is to be (m) over time: out at constant speed, dwell, back."""
    reach = params.gap + params.stroke
    back = params.departure + reach / params.speed
    times = [0.0, params.start, params.arrival, params.departure, back, back + 1.0]
    return PiecewisePolynomial.FirstOrderHold(times, [[0.0, 0.0, reach, reach, 0.0, 0.0]])


def approach(robot: RobotModel, touch: TouchPlace, radius: float) -> tuple[Array, Array]:
    """Return where a ball's centre is when it first touches the link at home (m, world), and the unit direction.

    Raises
    ------
    ParameterError
        If the line does not meet the link.
    """
    terms = evaluate_dynamics(robot, robot.home, np.zeros(robot.n))
    shapes, link = robot.shapes, robot.link_index(touch.link)
    aim = terms.position(link, np.asarray(touch.aim))
    d = np.asarray(touch.direction) / np.linalg.norm(touch.direction)
    R_WS, p_WS = shapes.in_world(terms.R_WL, terms.p_WL)
    chosen, way = shapes.link == link, _FAR
    # The distance changes by at most a step's length: steps of the distance itself never pass the surface.
    for _ in range(200):
        left = nearest_surface_point(shapes.kind, shapes.size, R_WS, p_WS, chosen, aim - way * d)[1] - radius
        if left < 1e-9:
            return aim - way * d, d
        way -= left
        if way < -_FAR:
            break
    raise ParameterError("touch.aim", f"a ball along {touch.direction} does not meet {touch.link}")


@dataclass(frozen=True)
class Ball(Body):
    """An elastic ball on a carrier that slides towards the arm; gravity does not act on it."""

    params: BallParameters = field(default_factory=BallParameters)

    def add_to(self, plant: MultibodyPlant, robot: RobotModel) -> None:
        """Add the model instance "ball": one joint and actuator, with position control of the travel (m, m/s)."""
        p = self.params
        contact, direction = approach(robot, p.touch, p.radius)
        instance = plant.AddModelInstance("ball")
        body = plant.AddRigidBody("ball", instance, SpatialInertia.SolidSphereWithMass(p.mass, p.radius))
        X_WB = RigidTransform(RotationMatrix.MakeFromOneVector(direction, 2), contact - p.gap * direction)
        frame = plant.AddFrame(FixedOffsetFrame("carrier", plant.world_frame(), X_WB, instance))
        joint = plant.AddJoint(PrismaticJoint("carrier", frame, body.body_frame(), [0.0, 0.0, 1.0]))
        actuator = plant.AddJointActuator("carrier", joint, 1.0e4)
        actuator.set_controller_gains(PdControllerGains(p=p.carrier_stiffness, d=p.carrier_damping))
        plant.set_gravity_enabled(instance, False)
        material, shape = point_contact(p.stiffness, p.dissipation, p.friction), Sphere(p.radius)
        plant.RegisterCollisionGeometry(body, RigidTransform(), shape, "ball", material)
        plant.RegisterVisualGeometry(body, RigidTransform(), shape, "ball", _RUBBER)
        rod = RigidTransform([0.0, 0.0, -p.radius - 0.1])
        plant.RegisterVisualGeometry(body, rod, Cylinder(0.012, 0.2), "rod", _STEEL)

    def connect(self, builder: DiagramBuilder, cell: Cell) -> None:
        """Move the carrier along `ball_path`."""
        touch_one_link(cell, "ball", self.params.touch.link)
        carrier = builder.AddNamedSystem("carrier", TrajectorySource(ball_path(self.params), 1))
        instance = cell.plant.GetModelInstanceByName("ball")
        builder.Connect(carrier.get_output_port(), cell.plant.get_desired_state_input_port(instance))


@dataclass
class WallParameters:
    """A wall that faces the arm, with a soft pad. All assumed."""

    touch: TouchPlace = field(default_factory=lambda: TouchPlace(direction=[0.0, -1.0, 0.0]))
    # m; distance of its surface from the cover of the arm at home.
    gap: float = 0.02
    # N/m, s/m and –; of the pad.
    stiffness: float = 3000.0
    dissipation: float = 3.0
    friction: float = 0.2
    # m; side and thickness.
    size: float = 0.5
    thickness: float = 0.06

    def __post_init__(self) -> None:
        require_positive(self, "gap", "stiffness", "size", "thickness")
        require_non_negative(self, "dissipation", "friction")


@dataclass(frozen=True)
class Wall(Body):
    """A wall that faces the arm, with a soft pad."""

    params: WallParameters = field(default_factory=WallParameters)

    def add_to(self, plant: MultibodyPlant, robot: RobotModel) -> None:
        """Add the model instance "wall", the middle of its surface on the line of the touch."""
        p = self.params
        contact, normal = approach(robot, p.touch, 0.0)
        instance = plant.AddModelInstance("wall")
        body = plant.AddRigidBody("wall", instance, SpatialInertia.SolidBoxWithMass(1.0, 0.1, 0.1, 0.1))
        X_WP = RigidTransform(
            RotationMatrix.MakeFromOneVector(normal, 2), contact - (p.gap + 0.5 * p.thickness) * normal
        )
        plant.WeldFrames(plant.world_frame(), body.body_frame(), X_WP)
        material, shape = point_contact(p.stiffness, p.dissipation, p.friction), Box(p.size, p.size, p.thickness)
        plant.RegisterCollisionGeometry(body, RigidTransform(), shape, "pad", material)
        plant.RegisterVisualGeometry(body, RigidTransform(), shape, "pad", _PAD)

    def connect(self, builder: DiagramBuilder, cell: Cell) -> None:
        """Let it touch one link alone."""
        touch_one_link(cell, "wall", self.params.touch.link)


def touch_one_link(cell: Cell, name: str, link: str) -> None:
    """Let the body of this name collide with that body of the robot alone."""

    def shapes(bodies: Iterable[RigidBody]) -> GeometrySet:
        return GeometrySet([shape for body in bodies for shape in cell.plant.GetCollisionGeometriesForBody(body)])

    robot = (cell.plant.get_body(index) for index in cell.plant.GetBodyIndices(cell.instance))
    others, obstacle = shapes(body for body in robot if body.name() != link), shapes([cell.plant.GetBodyByName(name)])
    filters = cell.scene_graph.collision_filter_manager()
    filters.Apply(CollisionFilterDeclaration().ExcludeBetween(others, obstacle))
