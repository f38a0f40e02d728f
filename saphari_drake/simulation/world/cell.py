"""The cell: a robot and what is around it, as one discrete plant with its scene graph."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import SceneGraph
from pydrake.multibody.plant import ContactResults, MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.systems.framework import DiagramBuilder, InputPort, OutputPort

from saphari_drake.robots.dynamics import evaluate_dynamics
from saphari_drake.robots.model import RobotModel
from saphari_drake.simulation.world.actuators import Actuators
from saphari_drake.simulation.world.plant import PlantParameters, add_plant, add_robot, cover, torque_input
from saphari_drake.simulation.world.profile import PlantProfile, Truth

Array = NDArray[np.float64]


class Body:
    """Something beside the robot. It keeps nothing of a plant, so that it can be added to several."""

    def add_to(self, plant: MultibodyPlant, robot: RobotModel) -> None:
        """Add what it consists of to a plant that is not finalized; the robot will stand at home."""
        raise NotImplementedError

    def connect(self, builder: DiagramBuilder, cell: "Cell") -> None:
        """Add the systems that move it, and connect them to the finished cell."""


@dataclass(frozen=True)
class Cell:
    """What `add_cell` put into a diagram, and the ports that others connect to.

    Attributes
    ----------
    robot, bodies, params
        What the cell was made of.
    plant, scene_graph
    instance : ModelInstanceIndex
        The robot in the plant.
    torque_input : InputPort
        n (Nm or N), in joint order; what the controllers apply.
    torque_driving : OutputPort or None
        n (Nm or N), what the joints get of it; None: all of it at once.
    link_of_body : mapping
        Link of each of the robot's bodies by its index; −1: the base.
    """

    robot: RobotModel
    bodies: Sequence[Body]
    params: PlantParameters
    plant: MultibodyPlant
    scene_graph: SceneGraph
    instance: ModelInstanceIndex
    torque_input: InputPort
    torque_driving: OutputPort | None
    link_of_body: dict[int, int]

    @property
    def robot_state(self) -> OutputPort:
        """State of the robot, 2n (rad or m, then rad/s or m/s)."""
        return self.plant.get_state_output_port(self.instance)

    @property
    def contact_torque(self) -> OutputPort:
        """J_cᵀF of all contact forces on the robot, n (Nm or N): −τ_ext."""
        return self.plant.get_generalized_contact_forces_output_port(self.instance)

    @property
    def contact_results(self) -> OutputPort:
        """Contacts of the plant, for `contact_truth`."""
        return self.plant.get_contact_results_output_port()

    def copy_to(self, builder: DiagramBuilder) -> MultibodyPlant:
        """Add the same cell to another diagram, to show it; return its plant."""
        return add_cell(builder, self.robot, self.bodies, self.params).plant


def add_cell(
    builder: DiagramBuilder,
    robot: RobotModel,
    bodies: Sequence[Body] = (),
    plant: PlantParameters | None = None,
    truth: Truth | None = None,
) -> Cell:
    """Add a robot at its home posture, and bodies around it, to a diagram; `truth`: how it differs from its model."""
    params, truth = plant or PlantParameters(), truth or Truth()
    world, scene_graph = add_plant(builder, params)
    instance = add_robot(world, robot, params, truth)
    for body in bodies:
        body.add_to(world, robot)
    world.Finalize()
    world.SetDefaultPositions(instance, robot.home)
    if params.geometry:
        cover(world, scene_graph, instance, params)
    links = {int(index): -1 for index in world.GetBodyIndices(instance)}
    for link, name in enumerate(robot.link_names):
        welded = world.GetBodiesWeldedTo(world.GetBodyByName(name, instance))
        links |= {int(part.index()): link for part in welded}
    torque = torque_input(builder, robot, world, instance)
    driving = None
    if truth.profile != PlantProfile():
        weight = evaluate_dynamics(robot, robot.home, np.zeros(robot.n)).g
        drives = builder.AddNamedSystem("actuators", Actuators(robot, truth, params.time_step, weight))
        builder.Connect(world.get_state_output_port(instance), drives.GetInputPort("state"))
        driving = drives.get_output_port()
        builder.Connect(driving, torque)
        torque = drives.GetInputPort("torque_applied")
    cell = Cell(robot, bodies, params, world, scene_graph, instance, torque, driving, links)
    for body in bodies:
        body.connect(builder, cell)
    return cell


def contact_truth(results: ContactResults, cell: Cell) -> Array:
    """Return the true contact of the robot with what is around it from the plant's contact results, to judge by alone.

    Returns
    -------
    (7,) array
        Force on the robot (N, world), force-weighted contact point (m, world) and index of the touched link (−1: the
        base, or no contact); zeros without contact.
    """
    force, point, weight, link = np.zeros(3), np.zeros(3), 0.0, -1
    for i in range(results.num_point_pair_contacts()):
        info = results.point_pair_contact_info(i)
        touched = [int(index) for index in (info.bodyA_index(), info.bodyB_index()) if int(index) in cell.link_of_body]
        size = float(np.linalg.norm(info.contact_force()))
        if len(touched) != 1 or size == 0.0:
            continue
        # contact_force() acts on body B.
        force += info.contact_force() * (1.0 if touched[0] == int(info.bodyB_index()) else -1.0)
        point += size * info.contact_point()
        weight += size
        link = cell.link_of_body[touched[0]]
    return np.array([*force, *(point / weight if weight > 0.0 else point), link])
