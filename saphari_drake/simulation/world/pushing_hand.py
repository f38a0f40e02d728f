"""A person's hand in the cell: its body, and the person who moves it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import DiagramBuilder

from saphari_drake.robots.model import RobotModel
from saphari_drake.simulation.people.pushing_hand import HumanHand, Push
from saphari_drake.simulation.world.cell import Body, Cell
from saphari_drake.simulation.world.hand import HandParameters, add_hand


@dataclass(frozen=True)
class PushingHand(Body):
    """A hand that pushes the robot; without pushes it lies where it is put.

    Attributes
    ----------
    pushes : sequence of Push
    params : HandParameters
    force_profile, robot_stiffness
        As `HumanHand` takes them.
    """

    pushes: Sequence[Push] = ()
    params: HandParameters = field(default_factory=HandParameters)
    force_profile: Callable[[float], NDArray[np.float64] | None] | None = None
    robot_stiffness: float = 500.0

    def add_to(self, plant: MultibodyPlant, robot: RobotModel) -> None:
        """Add the hand as the model instance "hand"; gravity does not act on it."""
        plant.set_gravity_enabled(add_hand(plant, self.params).model_instance(), False)

    def connect(self, builder: DiagramBuilder, cell: Cell) -> None:
        """Add the person as "human_hand"; the hand starts before its first target."""
        plant = cell.plant
        hand = plant.GetBodyByName("hand")
        if not self.pushes:
            return
        counts = plant.num_velocities(), hand.floating_velocities_start_in_v()
        person = HumanHand(cell.robot, self.params, self.pushes, *counts, self.force_profile, self.robot_stiffness)
        builder.AddNamedSystem("human_hand", person)
        plant.SetDefaultFloatingBaseBodyPose(hand, person.start_pose())
        builder.Connect(plant.get_state_output_port(hand.model_instance()), person.GetInputPort("hand_state"))
        builder.Connect(cell.robot_state, person.GetInputPort("robot_state"))
        builder.Connect(person.get_output_port(), plant.get_applied_generalized_force_input_port())
