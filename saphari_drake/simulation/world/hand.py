"""A person's hand as a free body with compliant contact."""

from dataclasses import dataclass

import numpy as np
from pydrake.geometry import Capsule, Sphere
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import RigidBody, SpatialInertia, UnitInertia

from saphari_drake.parameters import require_non_negative, require_positive
from saphari_drake.simulation.world.plant import point_contact

_SKIN = np.array([0.89, 0.71, 0.58, 1.0])


@dataclass
class HandParameters:
    """A hand with stretched finger and forearm, and how it gives way. All assumed."""

    # m; finger (the part that touches), fist and forearm.
    finger_radius: float = 0.012
    finger_length: float = 0.07
    fist_radius: float = 0.042
    forearm_radius: float = 0.038
    forearm_length: float = 0.24
    # kg; the share of hand and forearm that moves with the contact.
    mass: float = 1.0
    # m; radius of gyration about the centre of mass, between fist and forearm.
    gyration: float = 0.08
    # N/m and s/m; compliance of the finger's tissue and its dissipation (Hunt–Crossley).
    tissue_stiffness: float = 1.0e4
    dissipation: float = 1.0
    # Friction of skin on the robot's cover.
    friction: float = 0.8
    # N/m and Ns/m; spring and damper with which the arm moves the hand along its path.
    stiffness: float = 1000.0
    damping: float = 30.0
    # Nm/rad and Nms/rad; the same for its orientation.
    turn_stiffness: float = 50.0
    turn_damping: float = 1.5

    def __post_init__(self) -> None:
        require_positive(
            self, "finger_radius", "finger_length", "fist_radius", "forearm_radius", "forearm_length", "mass",
            "gyration", "tissue_stiffness", "stiffness", "turn_stiffness",
        )  # fmt: skip
        require_non_negative(self, "dissipation", "friction", "damping", "turn_damping")


def add_hand(plant: MultibodyPlant, params: HandParameters, name: str = "hand") -> RigidBody:
    """Add a free body H, origin at the centre of the fingertip, x along the finger towards the tip; return it.

    It carries its own weight: gravity does not act on it.
    """
    instance = plant.AddModelInstance(name)
    p_HC = np.array([-params.finger_length - params.fist_radius, 0.0, 0.0])
    unit = UnitInertia(*[params.gyration**2] * 3)
    body = plant.AddRigidBody(name, instance, SpatialInertia(params.mass, p_HC, unit.ShiftFromCenterOfMass(p_HC)))
    if plant.geometry_source_is_registered():
        finger_centre = -params.finger_length / 2
        fist_centre = -params.finger_length - 0.7 * params.fist_radius
        forearm_centre = fist_centre - params.forearm_length / 2
        _add_shape(plant, body, "finger", Capsule(params.finger_radius, params.finger_length), finger_centre, params)
        _add_shape(plant, body, "fist", Sphere(params.fist_radius), fist_centre, params)
        forearm = Capsule(params.forearm_radius, params.forearm_length)
        _add_shape(plant, body, "forearm", forearm, forearm_centre, params)
    return body


def _add_shape(plant: MultibodyPlant, body: RigidBody, name: str, shape, x: float, params: HandParameters) -> None:
    X_HG = RigidTransform(RotationMatrix.MakeYRotation(np.pi / 2), [x, 0.0, 0.0])
    skin = point_contact(params.tissue_stiffness, params.dissipation, params.friction)
    plant.RegisterCollisionGeometry(body, X_HG, shape, name, skin)
    plant.RegisterVisualGeometry(body, X_HG, shape, name, _SKIN)
