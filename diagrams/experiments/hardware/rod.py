"""The rod in Drake's plant."""

from dataclasses import dataclass

import numpy as np
from pydrake.geometry import Sphere
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import FixedOffsetFrame, PrismaticJoint, SpatialInertia
from pydrake.systems.framework import BasicVector, Context, DiagramBuilder, LeafSystem

from experiments.hardware.rod_law import RodParameters, rod_force
from saphari_drake.robots.model import RobotModel
from saphari_drake.simulation.world.cell import Body, Cell
from saphari_drake.simulation.world.obstacles import TouchPlace, approach, touch_one_link
from saphari_drake.simulation.world.plant import point_contact

_STEEL = np.array([0.5, 0.5, 0.5, 1.0])
STIFFNESS, DISSIPATION, FRICTION = 2.0e4, 1.0, 0.1  # N/m, s/m, –; of the ball on the cover. Assumed


def rail(robot: RobotModel, rod: RodParameters) -> tuple[np.ndarray, np.ndarray]:
    """Return where the ball's centre waits (m, world), and the direction of the rail."""
    contact, direction = approach(robot, TouchPlace(rod.link, rod.aim, rod.direction), rod.radius)
    return contact - rod.gap * direction, direction


@dataclass(frozen=True)
class Rod(Body):
    """A ball on a rail; gravity does not act on it."""

    params: RodParameters

    def add_to(self, plant: MultibodyPlant, robot: RobotModel) -> None:
        """Add the model instance "rod": one joint and actuator."""
        p = self.params
        origin, direction = rail(robot, p)
        instance = plant.AddModelInstance("rod")
        body = plant.AddRigidBody("rod", instance, SpatialInertia.SolidSphereWithMass(p.mass, p.radius))
        X_WB = RigidTransform(RotationMatrix.MakeFromOneVector(direction, 2), origin)
        frame = plant.AddFrame(FixedOffsetFrame("rail", plant.world_frame(), X_WB, instance))
        joint = plant.AddJoint(PrismaticJoint("rail", frame, body.body_frame(), [0.0, 0.0, 1.0]))
        plant.AddJointActuator("rod", joint, 1.0e4)
        plant.set_gravity_enabled(instance, False)
        material = point_contact(STIFFNESS, DISSIPATION, FRICTION)
        plant.RegisterCollisionGeometry(body, RigidTransform(), Sphere(p.radius), "rod", material)
        plant.RegisterVisualGeometry(body, RigidTransform(), Sphere(p.radius), "rod", _STEEL)

    def connect(self, builder: DiagramBuilder, cell: Cell) -> None:
        """Move it by its law, and let it touch one link alone: the covers of neighbours overlap at a joint."""
        touch_one_link(cell, "rod", self.params.link)
        drive = builder.AddNamedSystem("rod_drive", RodDrive(self.params))
        instance = cell.plant.GetModelInstanceByName("rod")
        builder.Connect(cell.plant.get_state_output_port(instance), drive.GetInputPort("state"))
        builder.Connect(drive.GetOutputPort("force"), cell.plant.get_actuation_input_port(instance))


class RodDrive(LeafSystem):
    """Moves the rod by `rod_force`.

    .. pydrake_system::

        name: RodDrive
        input_ports:
        - state
        output_ports:
        - force

    Ports
    -----
    state : 2 (m, m/s), of the rod along its rail.
    force : 1 (N).
    """

    def __init__(self, params: RodParameters) -> None:
        super().__init__()
        self._params = params
        state = self.DeclareVectorInputPort("state", BasicVector(2))

        def calc(context: Context, output: BasicVector) -> None:
            output.SetFromVector([rod_force(params, context.get_time(), *state.Eval(context))])

        self.DeclareVectorOutputPort("force", BasicVector(1), calc, {state.ticket(), self.time_ticket()})
