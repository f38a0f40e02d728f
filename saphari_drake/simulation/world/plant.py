"""The simulated robot: what its plant is made with that no controller knows of."""

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
from pydrake.multibody.plant import AddMultibodyPlant, CoulombFriction, MultibodyPlant, MultibodyPlantConfig
from pydrake.multibody.tree import ModelInstanceIndex, PdControllerGains, SpatialInertia
from pydrake.systems.framework import DiagramBuilder, InputPort
from pydrake.systems.primitives import ConstantVectorSource, MatrixGain

from saphari_drake.parameters import diagonal, require_choice, require_non_negative, require_within
from saphari_drake.robots.catalog import reported_friction
from saphari_drake.robots.model import RobotModel
from saphari_drake.simulation.world.profile import Truth, joint_scale
from saphari_drake.simulation.world.true_model import PAYLOAD_HEIGHT, PAYLOAD_RADIUS

Array = NDArray[np.float64]
COVER_STIFFNESS = 1.0e9  # N/m; in series with an obstacle it changes nothing
STICK = 1.0e5  # Nms/rad; a joint that sticks creeps with load/STICK


@dataclass
class PlantParameters:
    """The simulated robot and how it makes contact."""

    # s; step of the discrete plant.
    time_step: float = 0.001
    # Drake's model of contact: point, hydroelastic or hydroelastic_with_fallback.
    contact_model: str = "point"
    # Whether the robot's links collide with one another.
    self_contact: bool = False
    # Whether the robot's cover is rigid, so that the stiffness of a contact is that of what touches it. Otherwise it
    # has Drake's own material.
    rigid_cover: bool = False
    # Whether shapes are loaded. Without them the robot moves the same but touches nothing and is not shown: for model
    # files whose meshes cannot be found.
    geometry: bool = True
    # Nm (N), Coulomb friction of each joint, and Nms/rad (Ns/m), viscous, used with `friction_share`. Empty: as
    # reported for the LWR4, and for another arm as large a share of its torque limits in the mean.
    coulomb: list[float] = field(default_factory=list)
    viscous: list[float] = field(default_factory=list)
    # Share of that friction that acts; 0: none.
    friction_share: float = 0.0
    # kg; at the origin of the last link's frame, 5 cm farther along its z.
    payload: float = 0.0

    def __post_init__(self) -> None:
        require_within(self, 1e-5, 0.1, "time_step")
        require_non_negative(self, "friction_share", "payload")
        require_choice(self, "contact_model", ("point", "hydroelastic", "hydroelastic_with_fallback"))


def add_plant(builder: DiagramBuilder, params: PlantParameters) -> tuple[MultibodyPlant, SceneGraph]:
    """Add an empty plant and its scene graph to a diagram."""
    config = MultibodyPlantConfig(time_step=params.time_step, contact_model=params.contact_model)
    if params.geometry:
        return AddMultibodyPlant(config, builder)
    plant = builder.AddNamedSystem("plant", MultibodyPlant(params.time_step))
    return plant, builder.AddNamedSystem("scene_graph", SceneGraph())


def add_robot(plant: MultibodyPlant, robot: RobotModel, params: PlantParameters, truth: Truth) -> ModelInstanceIndex:
    """Add a robot with its payload and joint friction to a plant that is not finalized."""
    instance = robot.add_to(plant)
    _change_inertia(plant, robot, instance, truth)
    payload = params.payload + truth.profile.payload
    if payload > 0.0:
        body = plant.AddRigidBody("payload", instance, SpatialInertia.SolidSphereWithMass(payload, PAYLOAD_RADIUS))
        last = plant.GetBodyByName(robot.link_names[-1], instance)
        plant.WeldFrames(last.body_frame(), body.body_frame(), RigidTransform([0.0, 0.0, PAYLOAD_HEIGHT]))
    _add_friction(plant, robot, instance, *joint_friction(robot, params, truth))
    return instance


def joint_friction(robot: RobotModel, params: PlantParameters, truth: Truth) -> tuple[Array, Array]:
    """Return Coulomb (Nm or N) and viscous friction (Nms/rad or Ns/m) of the joints, that of the file included."""
    share, scale = params.friction_share, joint_scale(robot)
    coulomb, viscous = truth.profile.coulomb * scale, truth.profile.viscous * scale + robot.viscous
    if share == 0.0:
        return coulomb, viscous
    dry, damping = (
        diagonal(getattr(params, name) or reported_friction(robot, name), robot.n, name)
        for name in ("coulomb", "viscous")
    )
    return coulomb + share * dry, viscous + share * damping


def _change_inertia(plant: MultibodyPlant, robot: RobotModel, instance: ModelInstanceIndex, truth: Truth) -> None:
    """Make motors and links other than the model says: a body of the difference, also negative, is welded to a link."""
    if truth.profile.rotor_error > 0.0:
        scale = dict(zip(robot.joint_names, truth.rotor_scale(robot)))
        for index in plant.GetJointActuatorIndices():
            actuator = plant.get_joint_actuator(index)
            if actuator.model_instance() == instance:
                inertia = scale[actuator.joint().name()] * actuator.default_rotor_inertia()
                actuator.set_default_rotor_inertia(inertia)
    if truth.profile.mass_error > 0.0:
        links = [plant.GetBodyByName(name, instance) for name in robot.link_names]
        moved = [(body, s) for link, s in zip(links, truth.mass_scale(robot)) for body in plant.GetBodiesWeldedTo(link)]
        for body, scale in moved:
            own = body.default_spatial_inertia()
            if own.get_mass() > 0.0:
                mass = (scale - 1.0) * own.get_mass()
                more = SpatialInertia(mass, own.get_com(), own.get_unit_inertia(), skip_validity_check=True)
                added = plant.AddRigidBody(f"{body.name()} error", instance, more)
                plant.WeldFrames(body.body_frame(), added.body_frame(), RigidTransform())


def _add_friction(
    plant: MultibodyPlant, robot: RobotModel, instance: ModelInstanceIndex, coulomb: Array, viscous: Array
) -> None:
    """Coulomb friction is a stiff speed control to zero with little effort: implicit, so that it sticks at any step.

    Of two actuators of a joint Drake takes the reflected inertia of the last one, which has to be that of the motor.
    """
    actuators = [plant.get_joint_actuator(index) for index in plant.GetJointActuatorIndices()]
    motors = {motor.joint().name(): motor for motor in actuators if motor.model_instance() == instance}
    for name, limit, damping in zip(robot.joint_names, coulomb, viscous):
        joint = plant.GetJointByName(name, instance)
        if damping > 0.0:
            joint.set_default_damping(damping)
        if limit > 0.0:
            brake = plant.AddJointActuator(f"friction {name}", joint, limit)
            brake.set_default_rotor_inertia(motors[name].default_rotor_inertia())
            brake.set_default_gear_ratio(motors[name].default_gear_ratio())
            brake.set_controller_gains(PdControllerGains(p=1e-6, d=STICK))


def torque_input(
    builder: DiagramBuilder, robot: RobotModel, plant: MultibodyPlant, instance: ModelInstanceIndex
) -> InputPort:
    """Return the input of the joint torques in joint order, whatever the order of the actuators; brakes get none."""
    port = plant.get_actuation_input_port(instance)
    gain = np.zeros((port.size(), robot.n))
    gain[: robot.n] = np.eye(robot.n)[robot.actuator_order]
    if port.size() > robot.n:
        rest = builder.AddNamedSystem("rest", ConstantVectorSource(np.zeros(2 * port.size())))
        builder.Connect(rest.get_output_port(), plant.get_desired_state_input_port(instance))
    if np.array_equal(gain, np.eye(robot.n)):
        return port
    order = builder.AddNamedSystem("actuator_order", MatrixGain(gain))
    builder.Connect(order.get_output_port(), port)
    return order.get_input_port()


def cover(
    plant: MultibodyPlant, scene_graph: SceneGraph, instance: ModelInstanceIndex, params: PlantParameters
) -> None:
    """Give the robot's shapes their material, and say whether they collide with one another."""
    bodies = [plant.get_body(index) for index in plant.GetBodyIndices(instance)]
    shapes = [shape for body in bodies for shape in plant.GetCollisionGeometriesForBody(body)]
    if params.rigid_cover:
        for shape in shapes:
            rigid = point_contact(COVER_STIFFNESS, 0.0, 1.0)
            scene_graph.AssignRole(plant.get_source_id(), shape, rigid, RoleAssign.kReplace)
    if not params.self_contact:
        inside = CollisionFilterDeclaration().ExcludeWithin(GeometrySet(shapes))
        scene_graph.collision_filter_manager().Apply(inside)


def point_contact(stiffness: float, dissipation: float, friction: float) -> ProximityProperties:
    """Return the material of a shape: N/m, s/m (Hunt–Crossley), and the coefficient of friction."""
    properties = ProximityProperties()
    AddContactMaterial(
        properties=properties,
        dissipation=dissipation,
        point_stiffness=stiffness,
        friction=CoulombFriction(friction, friction),
    )
    return properties
