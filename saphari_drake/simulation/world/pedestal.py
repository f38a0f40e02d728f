"""A column that viewers see below a robot."""

from dataclasses import dataclass

import numpy as np
from pydrake.geometry import Cylinder
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import SpatialInertia

from saphari_drake.robots.model import RobotModel
from saphari_drake.simulation.world.cell import Body

_GREY = np.array([0.45, 0.47, 0.50, 1.0])


@dataclass(frozen=True)
class Pedestal(Body):
    """A column of a height (m) and a radius (m) on the floor, at the origin; nothing collides with it."""

    height: float = 0.6
    radius: float = 0.11

    def add_to(self, plant: MultibodyPlant, robot: RobotModel | None = None) -> None:
        """Add it, welded to the world."""
        instance = plant.AddModelInstance("pedestal")
        inertia = SpatialInertia.SolidCylinderWithMass(1.0, self.radius, self.height, [0.0, 0.0, 1.0])
        body = plant.AddRigidBody("pedestal", instance, inertia)
        plant.WeldFrames(plant.world_frame(), body.body_frame(), RigidTransform([0.0, 0.0, 0.5 * self.height]))
        if plant.geometry_source_is_registered():
            shape = Cylinder(self.radius, self.height)
            plant.RegisterVisualGeometry(body, RigidTransform(), shape, "pedestal", _GREY)
