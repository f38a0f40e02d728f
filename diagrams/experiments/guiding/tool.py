"""The tool of the wrist sensor as it is identified before the hands come: from readings at rest in some postures."""

import numpy as np
from numpy.typing import NDArray

from saphari_drake.perception.wrench.identification import identify_tool
from saphari_drake.perception.wrench.tool import ToolParameters, sensor_mount, tool_wrench
from saphari_drake.robots.dynamics import evaluate_dynamics
from saphari_drake.robots.model import RobotModel
from saphari_drake.simulation.sensors.force_torque_sensor import ForceTorqueSensorParameters
from saphari_drake.simulation.world.profile import Truth
from saphari_drake.simulation.world.true_model import true_robot

Array = NDArray[np.float64]
POSTURES, SAMPLES, REACH = 12, 50, 1.0  # samples averaged in each posture; rad by which the last joints differ. Assumed


def true_tool(robot: RobotModel, truth: Truth, joint: str) -> ToolParameters:
    """Return what the sensor carries in the simulation; what its link has more than the model counts as the tool's."""
    link, X_LS, own = sensor_mount(robot, joint)
    real, known = true_robot(robot, truth).tree, robot.tree
    mass = float(real.mass[link] - known.mass[link])
    moment = real.mass[link] * real.com[link] - known.mass[link] * known.com[link]
    more = X_LS.rotation().matrix().T @ (moment - mass * X_LS.translation())
    total = own.mass + mass
    return ToolParameters(total, ((own.mass * np.asarray(own.com) + more) / total).tolist(), list(own.inertia))


def identified_tool(robot: RobotModel, truth: Truth, sensor: ForceTorqueSensorParameters) -> ToolParameters | None:
    """Return the tool as `identify_tool` finds it, with the model's inertia; None: the model's own tool.

    None where nothing is off, and under faults of the payload and the model, which nobody knows of.
    """
    off = truth.profile.payload > 0.0 or truth.profile.mass_error > 0.0
    if not off or {"payload", "model_error"} & set(truth.faults):
        return None
    link, X_LS, own = sensor_mount(robot, sensor.joint)
    rng, tool = np.random.default_rng([truth.seed, sensor.seed, 11]), true_tool(robot, truth, sensor.joint)
    turns = np.zeros((POSTURES, robot.n))
    turns[:, -4:] = rng.uniform(-REACH, REACH, turns[:, -4:].shape)
    postures = np.clip(robot.home + turns, robot.q_min, robot.q_max)
    R_WL = [evaluate_dynamics(robot, q, np.zeros(robot.n)).R_WL[link] for q in postures]
    R_WS, g_W = np.array(R_WL) @ X_LS.rotation().matrix(), np.array(robot.tree.gravity)
    bias = np.repeat([sensor.bias_torque, sensor.bias_force], 3) * rng.uniform(-1.0, 1.0, 6)
    noise = np.repeat([sensor.noise_torque, sensor.noise_force], 3) / np.sqrt(SAMPLES)
    readings = [tool_wrench(tool, R, g_W) + bias + noise * rng.standard_normal(6) for R in R_WS]
    found = identify_tool(R_WS, np.array(readings), g_W).tool
    return ToolParameters(found.mass, found.com, list(own.inertia))
