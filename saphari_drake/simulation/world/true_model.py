"""The model that the simulated robot really has."""

from copy import copy

import numpy as np
from numpy.typing import ArrayLike, NDArray

from saphari_drake.robots.corrections import with_payload
from saphari_drake.robots.dynamics import evaluate_dynamics
from saphari_drake.robots.model import RobotModel
from saphari_drake.simulation.world.profile import Truth, joint_scale

Array = NDArray[np.float64]

PAYLOAD_HEIGHT, PAYLOAD_RADIUS = 0.05, 0.04  # m, along z of the last link's frame; a ball


def true_robot(robot: RobotModel, truth: Truth, payload: float = 0.0) -> RobotModel:
    """Return the robot with the masses and inertias of its plant; `payload` (kg) is known, that of `truth` is added."""
    tree, scale = robot.file_tree, truth.mass_scale(robot)
    tree = tree._replace(
        mass=scale * tree.mass,
        inertia=scale[:, None, None] * tree.inertia,
        armature=truth.rotor_scale(robot) * tree.armature,
    )
    other, centre = copy(robot), np.array([0.0, 0.0, PAYLOAD_HEIGHT])
    other.tree = with_payload(tree, payload + truth.profile.payload, centre, PAYLOAD_RADIUS)
    return other


def resting_residual(robot: RobotModel, truth: Truth, q: ArrayLike, rng: np.random.Generator) -> Array:
    """Return what a momentum observer takes for external torque while the robot rests at `q`, (n,) (Nm or N).

    Weight that the model does not know, bias and ripple of the drives, and dry friction, which takes any value up to
    its limit while a joint rests: drawn evenly.
    """
    zero, profile, scale = np.zeros(robot.n), truth.profile, joint_scale(robot)
    weight = evaluate_dynamics(true_robot(robot, truth), q, zero).g - evaluate_dynamics(robot, q, zero).g
    ripple = profile.torque_ripple * scale * np.sin(profile.ripple_waves * np.asarray(q) + truth.ripple_phase(robot))
    friction = profile.coulomb * scale * rng.uniform(-1.0, 1.0, robot.n)
    return truth.torque_bias(robot) + ripple + friction - weight
