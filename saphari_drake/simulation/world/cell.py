"""The cell: robot, hand and floor as one discrete plant with its scene graph."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import CollisionFilterDeclaration, GeometrySet, SceneGraph
from pydrake.multibody.plant import (
    AddMultibodyPlantSceneGraph,
    ContactModel,
    ContactResults,
    DiscreteContactApproximation,
    MultibodyPlant,
)
from pydrake.multibody.tree import ModelInstanceIndex, RigidBody
from pydrake.systems.framework import DiagramBuilder, InputPort, OutputPort
from pydrake.systems.primitives import MatrixGain

from saphari_drake.parameters import require_positive
from saphari_drake.robots.model import RobotModel
from saphari_drake.simulation.world.hand_and_floor import HandParameters, add_floor, add_hand

Array = NDArray[np.float64]


@dataclass
class CellParameters:
    """The simulated world."""

    # s; step of the discrete plant.
    time_step: float = 0.001
    # The person's hand.
    hand: HandParameters = field(default_factory=HandParameters)

    def __post_init__(self) -> None:
        require_positive(self, "time_step")


@dataclass
class Cell:
    """What `add_cell` put into a diagram, and the ports that others connect to."""

    robot: RobotModel
    plant: MultibodyPlant
    scene_graph: SceneGraph
    instance: ModelInstanceIndex
    hand: RigidBody
    torque_input: InputPort  # n (Nm), joint order
    link_of_body: dict[int, int]  # link index of each of the robot's moving bodies
    robot_state: OutputPort  # 2n (rad, rad/s)
    hand_state: OutputPort  # 13: quaternion, position (m), angular and linear velocity
    hand_force_input: InputPort  # nv of the plant, generalized forces


def add_cell(builder: DiagramBuilder, robot: RobotModel, params: CellParameters | None = None) -> Cell:
    """Add robot, hand and floor to a diagram.

    The robot's links do not collide with one another: self-contact is not simulated.
    """
    params = params or CellParameters()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, params.time_step)
    plant.set_name("plant")
    plant.set_contact_model(ContactModel.kPoint)
    plant.set_discrete_contact_approximation(DiscreteContactApproximation.kLagged)
    instance = robot.add_to(plant)
    hand = add_hand(plant, params.hand)
    add_floor(plant)
    plant.set_gravity_enabled(hand.model_instance(), False)
    plant.Finalize()
    plant.SetDefaultPositions(instance, robot.home)
    ignore_self_contact(plant, scene_graph, instance)
    return Cell(
        robot=robot,
        plant=plant,
        scene_graph=scene_graph,
        instance=instance,
        hand=hand,
        torque_input=connect_torque(builder, robot, plant, instance),
        link_of_body={
            int(plant.GetBodyByName(name, instance).index()): link for link, name in enumerate(robot.link_names)
        },
        robot_state=plant.get_state_output_port(instance),
        hand_state=plant.get_state_output_port(hand.model_instance()),
        hand_force_input=plant.get_applied_generalized_force_input_port(),
    )


def connect_torque(
    builder: DiagramBuilder, robot: RobotModel, plant: MultibodyPlant, instance: ModelInstanceIndex
) -> InputPort:
    """Return the input port of the joint torques in joint order, whatever the order of the actuators is."""
    port = plant.get_actuation_input_port(instance)
    if np.array_equal(robot.actuator_order, np.arange(robot.n)):
        return port
    reorder = builder.AddNamedSystem("actuator_order", MatrixGain(np.eye(robot.n)[robot.actuator_order]))
    builder.Connect(reorder.get_output_port(), port)
    return reorder.get_input_port()


def ignore_self_contact(plant: MultibodyPlant, scene_graph: SceneGraph, instance: ModelInstanceIndex) -> None:
    """Let the robot's links not collide with one another."""
    bodies = [plant.get_body(index) for index in plant.GetBodyIndices(instance)]
    geometries = [g for body in bodies for g in plant.GetCollisionGeometriesForBody(body)]
    filters = scene_graph.collision_filter_manager()
    filters.Apply(CollisionFilterDeclaration().ExcludeWithin(GeometrySet(geometries)))


def contact_truth(results: ContactResults, cell: Cell) -> Array:
    """Return the true contact of the hand from the plant's contact results, for judging alone.

    Returns
    -------
    (7,) array
        Force of the hand on the robot (N, world), force-weighted contact point (m, world) and index of the touched
        link (−1: the base, or no contact); zeros without contact.
    """
    force, point, weight, link = np.zeros(3), np.zeros(3), 0.0, -1
    for i in range(results.num_point_pair_contacts()):
        info = results.point_pair_contact_info(i)
        bodies = info.bodyA_index(), info.bodyB_index()
        if cell.hand.index() not in bodies:
            continue
        # contact_force() acts on body B.
        touched, sign = (bodies[1], 1.0) if bodies[0] == cell.hand.index() else (bodies[0], -1.0)
        size = float(np.linalg.norm(info.contact_force()))
        if size > 0.0:
            force += sign * info.contact_force()
            point += size * info.contact_point()
            weight += size
            link = cell.link_of_body.get(int(touched), -1)
    return np.array([*force, *(point / weight if weight > 0.0 else point), link])
