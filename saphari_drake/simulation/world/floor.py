"""The floor that cameras and viewers see."""

from dataclasses import dataclass

import numpy as np
from pydrake.geometry import Box
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import SpatialInertia

from saphari_drake.robots.model import RobotModel
from saphari_drake.simulation.world.cell import Body

_GREY = np.array([0.80, 0.81, 0.83, 1.0])


@dataclass(frozen=True)
class Floor(Body):
    """A square of an edge `size` (m) below z = 0; nothing collides with it."""

    size: float = 4.0

    def add_to(self, plant: MultibodyPlant, robot: RobotModel | None = None) -> None:
        """Add it, welded to the world."""
        instance = plant.AddModelInstance("floor")
        body = plant.AddRigidBody("floor", instance, SpatialInertia.SolidBoxWithMass(1.0, self.size, self.size, 0.02))
        plant.WeldFrames(plant.world_frame(), body.body_frame(), RigidTransform([0.0, 0.0, -0.01]))
        if plant.geometry_source_is_registered():
            plant.RegisterVisualGeometry(body, RigidTransform(), Box(self.size, self.size, 0.02), "floor", _GREY)
