"""Things that touch the arm: an elastic ball on a position-controlled carrier, and a wall with a soft pad."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import AddContactMaterial, Box, Cylinder, ProximityProperties, Sphere
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import CoulombFriction, MultibodyPlant
from pydrake.multibody.tree import FixedOffsetFrame, PdControllerGains, PrismaticJoint, RigidBody, SpatialInertia
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from saphari_drake.errors import ParameterError
from saphari_drake.math.primitives import nearest_surface_point
from saphari_drake.parameters import require_non_negative, require_positive
from saphari_drake.robots.dynamics import evaluate_dynamics
from saphari_drake.robots.model import RobotModel

Array = NDArray[np.float64]
_RUBBER, _PAD, _STEEL = (
    np.array([0.16, 0.45, 0.70, 1.0]),
    np.array([0.55, 0.65, 0.55, 0.5]),
    np.array([0.5, 0.5, 0.5, 1]),
)
_FAR = 1.0  # m; from where the way of the ball to the arm is searched


@dataclass
class Touch:
    """Where on the arm, and from where. All A."""

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
    """Ball and its carrier. Stiffness, speed and dwell: the deliverable; the others A."""

    touch: Touch = field(default_factory=Touch)
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


def ball_travel(params: BallParameters, time: float) -> tuple[float, float]:
    """Return how far the carrier is to be (m) and how fast (m/s): out at constant speed, dwell, back."""
    reach = params.gap + params.stroke
    if time < params.start:
        return 0.0, 0.0
    if time < params.arrival:
        return params.speed * (time - params.start), params.speed
    if time < params.departure:
        return reach, 0.0
    back = reach - params.speed * (time - params.departure)
    return (back, -params.speed) if back > 0.0 else (0.0, 0.0)


def approach(robot: RobotModel, touch: Touch, radius: float) -> tuple[Array, Array]:
    """Return where a ball's centre is when it first touches the link at home (m, world), and the unit direction.

    Raises
    ------
    ParameterError
        If the line does not meet the link.
    """
    terms, shapes, link = (
        evaluate_dynamics(robot, robot.home, np.zeros(robot.n)),
        robot.shapes,
        robot.link_index(touch.link),
    )
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


def _material(stiffness: float, dissipation: float, friction: float) -> ProximityProperties:
    properties = ProximityProperties()
    AddContactMaterial(
        properties=properties,
        dissipation=dissipation,
        point_stiffness=stiffness,
        friction=CoulombFriction(friction, friction),
    )
    return properties


def add_ball(plant: MultibodyPlant, params: BallParameters, p_WB: Array, direction: Array) -> RigidBody:
    """Add the ball, centred at p_WB (m), on a carrier that slides along a unit direction; gravity does not act on it.

    Its model instance has one actuator with position control, fed by a desired state (m, m/s) of the travel.
    """
    instance = plant.AddModelInstance("ball")
    body = plant.AddRigidBody("ball", instance, SpatialInertia.SolidSphereWithMass(params.mass, params.radius))
    X_WB = RigidTransform(RotationMatrix.MakeFromOneVector(direction, 2), p_WB)
    frame = plant.AddFrame(FixedOffsetFrame("carrier", plant.world_frame(), X_WB, instance))
    joint = plant.AddJoint(PrismaticJoint("carrier", frame, body.body_frame(), [0.0, 0.0, 1.0]))
    actuator = plant.AddJointActuator("carrier", joint, 1.0e4)
    actuator.set_controller_gains(PdControllerGains(p=params.carrier_stiffness, d=params.carrier_damping))
    plant.set_gravity_enabled(instance, False)
    material = _material(params.stiffness, params.dissipation, params.friction)
    plant.RegisterCollisionGeometry(body, RigidTransform(), Sphere(params.radius), "ball", material)
    plant.RegisterVisualGeometry(body, RigidTransform(), Sphere(params.radius), "ball", _RUBBER)
    rod = RigidTransform([0.0, 0.0, -params.radius - 0.1])
    plant.RegisterVisualGeometry(body, rod, Cylinder(0.012, 0.2), "rod", _STEEL)
    return body


class BallCarrier(LeafSystem):
    """Moves the ball: out, dwell, back.

    .. pydrake_system::

        name: BallCarrier
        output_ports:
        - desired_state

    - `desired_state`: 2 (m, m/s), travel and speed by `ball_travel`, a function of time.
    """

    def __init__(self, params: BallParameters) -> None:
        super().__init__()
        self._params = params
        self.DeclareVectorOutputPort("desired_state", BasicVector(2), self._calc, {self.time_ticket()})

    def _calc(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(ball_travel(self._params, context.get_time()))


@dataclass
class WallParameters:
    """A wall that faces the arm, with a soft pad. All A."""

    touch: Touch = field(default_factory=lambda: Touch(direction=[0.0, -1.0, 0.0]))
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


def add_wall(plant: MultibodyPlant, params: WallParameters, p_WS: Array, normal: Array) -> RigidBody:
    """Add the wall, the middle of its surface at p_WS (m) and its unit normal towards the arm."""
    instance = plant.AddModelInstance("wall")
    body = plant.AddRigidBody("wall", instance, SpatialInertia.SolidBoxWithMass(1.0, 0.1, 0.1, 0.1))
    R_WP = RotationMatrix.MakeFromOneVector(normal, 2)
    X_WP = RigidTransform(R_WP, p_WS - 0.5 * params.thickness * normal)
    plant.WeldFrames(plant.world_frame(), body.body_frame(), X_WP)
    shape = Box(params.size, params.size, params.thickness)
    material = _material(params.stiffness, params.dissipation, params.friction)
    plant.RegisterCollisionGeometry(body, RigidTransform(), shape, "pad", material)
    plant.RegisterVisualGeometry(body, RigidTransform(), shape, "pad", _PAD)
    return body
