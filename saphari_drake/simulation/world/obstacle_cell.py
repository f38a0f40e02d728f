"""The cell of Section 5: a robot with a ball or a wall beside it, optional joint friction and unknown payload."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import (
    AddContactMaterial,
    CollisionFilterDeclaration,
    GeometrySet,
    ProximityProperties,
    RoleAssign,
    SceneGraph,
)
from pydrake.math import RigidTransform
from pydrake.multibody.plant import (
    AddMultibodyPlantSceneGraph,
    ContactModel,
    CoulombFriction,
    DiscreteContactApproximation,
    MultibodyPlant,
)
from pydrake.multibody.tree import ModelInstanceIndex, PdControllerGains, RigidBody, SpatialInertia
from pydrake.systems.framework import DiagramBuilder, InputPort, OutputPort
from pydrake.systems.primitives import ConstantVectorSource, MatrixGain

from saphari_drake.errors import ParameterError
from saphari_drake.parameters import diagonal, require_non_negative, require_positive
from saphari_drake.robots.model import RobotModel
from saphari_drake.simulation.world.ball_and_wall import (
    BallCarrier,
    BallParameters,
    Touch,
    WallParameters,
    add_ball,
    add_wall,
    approach,
)
from saphari_drake.simulation.world.hand_and_floor import add_floor

Array = NDArray[np.float64]
COVER_STIFFNESS = 1.0e9  # N/m; in series with an obstacle it changes nothing
STICK = 1.0e5  # Nms/rad; a joint that sticks creeps with load/STICK


@dataclass
class ObstacleCellParameters:
    """The simulated world."""

    # s; step of the discrete plant.
    time_step: float = 0.001
    # What is beside the arm: ball, wall or nothing.
    obstacle: str = "ball"
    ball: BallParameters = field(default_factory=BallParameters)
    wall: WallParameters = field(default_factory=WallParameters)
    # Nm (N), Coulomb friction of each joint, and Nms/rad (Ns/m), viscous; as reported for the LWR4, used with
    # `friction_share`.
    coulomb: list[float] = field(default_factory=lambda: [11.9, 11.5, 8.98, 8.35, 8.31, 4.72, 6.04])
    viscous: list[float] = field(default_factory=lambda: [14.4, 15.3, 6.55, 11.0, 4.29, 2.26, 1.6])
    # Share of that friction that acts; 0: none.
    friction_share: float = 0.0
    # kg; at the origin of the last link's frame, 5 cm farther along its z. No controller knows of it.
    payload: float = 0.0

    def __post_init__(self) -> None:
        require_positive(self, "time_step")
        require_non_negative(self, "friction_share", "payload")
        if self.obstacle not in ("ball", "wall", "nothing"):
            raise ParameterError("obstacle", f"must be ball, wall or nothing, got {self.obstacle}")


@dataclass
class ObstacleCell:
    """What `add_obstacle_cell` put into a diagram, and the ports that others connect to."""

    robot: RobotModel
    plant: MultibodyPlant
    scene_graph: SceneGraph
    instance: ModelInstanceIndex
    torque_input: InputPort  # n (Nm), joint order
    robot_state: OutputPort  # 2n (rad, rad/s)
    contact_torque: OutputPort  # n (Nm), J_cᵀF of all forces on the robot: −τ_ext


def add_obstacle_cell(
    builder: DiagramBuilder, robot: RobotModel, params: ObstacleCellParameters | None = None
) -> ObstacleCell:
    """Add robot, floor and obstacle to a diagram; the robot starts at home, and its links do not collide."""
    params = params or ObstacleCellParameters()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, params.time_step)
    plant.set_name("plant")
    plant.set_contact_model(ContactModel.kPoint)
    plant.set_discrete_contact_approximation(DiscreteContactApproximation.kLagged)
    instance = robot.add_to(plant)
    if params.payload > 0.0:
        _add_payload(plant, robot, instance, params.payload)
    if params.friction_share > 0.0:
        _add_friction(plant, robot, instance, params)
    add_floor(plant)
    obstacle, touch = _add_obstacle(plant, robot, params)
    plant.Finalize()
    plant.SetDefaultPositions(instance, robot.home)
    _cover(plant, scene_graph, instance)
    if obstacle is not None:
        _touch_one_link(plant, scene_graph, instance, obstacle, touch.link)
    if obstacle is not None and params.obstacle == "ball":
        carrier = builder.AddNamedSystem("carrier", BallCarrier(params.ball))
        builder.Connect(carrier.get_output_port(), plant.get_desired_state_input_port(obstacle.model_instance()))
    return ObstacleCell(
        robot,
        plant,
        scene_graph,
        instance,
        _torque_input(builder, robot, plant, instance),
        plant.get_state_output_port(instance),
        plant.get_generalized_contact_forces_output_port(instance),
    )


def _add_obstacle(
    plant: MultibodyPlant, robot: RobotModel, params: ObstacleCellParameters
) -> tuple[RigidBody | None, Touch]:
    if params.obstacle == "ball":
        contact, d = approach(robot, params.ball.touch, params.ball.radius)
        return add_ball(plant, params.ball, contact - params.ball.gap * d, d), params.ball.touch
    if params.obstacle == "wall":
        contact, d = approach(robot, params.wall.touch, 0.0)
        return add_wall(plant, params.wall, contact - params.wall.gap * d, d), params.wall.touch
    return None, Touch()


def _add_payload(plant: MultibodyPlant, robot: RobotModel, instance: ModelInstanceIndex, mass: float) -> None:
    body = plant.AddRigidBody("payload", instance, SpatialInertia.SolidSphereWithMass(mass, 0.04))
    last = plant.GetBodyByName(robot.link_names[-1], instance)
    plant.WeldFrames(last.body_frame(), body.body_frame(), RigidTransform([0.0, 0.0, 0.05]))


def _add_friction(
    plant: MultibodyPlant, robot: RobotModel, instance: ModelInstanceIndex, params: ObstacleCellParameters
) -> None:
    """Coulomb friction is a stiff speed control to zero with little effort: implicit, so that it sticks at any step."""
    coulomb = params.friction_share * diagonal(params.coulomb, robot.n, "coulomb")
    viscous = params.friction_share * diagonal(params.viscous, robot.n, "viscous")
    for name, limit, damping in zip(robot.joint_names, coulomb, viscous):
        joint = plant.GetJointByName(name, instance)
        joint.set_default_damping(damping)
        if limit > 0.0:
            brake = plant.AddJointActuator(f"friction {name}", joint, limit)
            brake.set_controller_gains(PdControllerGains(p=1e-6, d=STICK))


def _torque_input(
    builder: DiagramBuilder, robot: RobotModel, plant: MultibodyPlant, instance: ModelInstanceIndex
) -> InputPort:
    """Input port in joint order, whatever the order of the actuators is; brakes get no torque."""
    port = plant.get_actuation_input_port(instance)
    gain = np.zeros((port.size(), robot.n))
    gain[: robot.n] = np.eye(robot.n)[robot.actuator_order]
    brakes = port.size() - robot.n
    if brakes:
        rest = builder.AddNamedSystem("rest", ConstantVectorSource(np.zeros(2 * port.size())))
        builder.Connect(rest.get_output_port(), plant.get_desired_state_input_port(instance))
    order = builder.AddNamedSystem("actuator_order", MatrixGain(gain))
    builder.Connect(order.get_output_port(), port)
    return order.get_input_port()


def _geometries(plant: MultibodyPlant, instance: ModelInstanceIndex) -> dict[str, list]:
    bodies = [plant.get_body(index) for index in plant.GetBodyIndices(instance)]
    return {body.name(): plant.GetCollisionGeometriesForBody(body) for body in bodies}


def _cover(plant: MultibodyPlant, scene_graph: SceneGraph, instance: ModelInstanceIndex) -> None:
    """Make the robot's cover rigid, so that the stiffness of a contact is the obstacle's, and stop self-contact."""
    everything = [g for geometries in _geometries(plant, instance).values() for g in geometries]
    for geometry in everything:
        properties = ProximityProperties()
        AddContactMaterial(
            properties=properties, dissipation=0.0, point_stiffness=COVER_STIFFNESS, friction=CoulombFriction(1.0, 1.0)
        )
        scene_graph.AssignRole(plant.get_source_id(), geometry, properties, RoleAssign.kReplace)
    filters = scene_graph.collision_filter_manager()
    filters.Apply(CollisionFilterDeclaration().ExcludeWithin(GeometrySet(everything)))


def _touch_one_link(
    plant: MultibodyPlant, scene_graph: SceneGraph, instance: ModelInstanceIndex, obstacle: RigidBody, link: str
) -> None:
    others = [g for name, geometries in _geometries(plant, instance).items() if name != link for g in geometries]
    pad = plant.GetCollisionGeometriesForBody(obstacle)
    filters = scene_graph.collision_filter_manager()
    filters.Apply(CollisionFilterDeclaration().ExcludeBetween(GeometrySet(others), GeometrySet(pad)))
