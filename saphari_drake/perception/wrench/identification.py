"""A tool and the bias of its sensor, identified from readings at rest in some postures.

Run: python -m saphari_drake.perception.wrench.identification ROBOT READINGS.csv [--joint NAME]

A row of READINGS.csv is a posture: the joint positions (rad or m), then the reading at S while nobody touches, moment
(Nm) and force (N). Lines that start with # are skipped. Printed is what `ToolParameters` takes.
"""

import argparse
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from saphari_drake.errors import SaphariError, StateError
from saphari_drake.perception.wrench.tool import ToolParameters, sensor_mount
from saphari_drake.robots import catalog
from saphari_drake.robots.dynamics import evaluate_dynamics

Array = NDArray[np.float64]


class ToolIdentification(NamedTuple):
    """A tool as static postures show it."""

    tool: ToolParameters
    bias: Array  # (6,) moment (Nm) and force (N) of the sensor without load
    residual_torque: float  # Nm, root mean square
    residual_force: float  # N, root mean square


def identify_tool(R_WS: Array, wrenches: Array, g_W: Array) -> ToolIdentification:
    """Identify mass, centre of mass and bias from readings at rest, by least squares.

    f = m g_S + b_f and τ = (m p) × g_S + b_τ are linear in m, m p and the bias.

    Parameters
    ----------
    R_WS : (k, 3, 3) array
        Orientations of the sensor.
    wrenches : (k, 6) array
        Readings (Nm, N) at S, in S, while nobody touches.
    g_W : (3,) array
        Gravity (m/s²).

    Raises
    ------
    StateError
        If sizes differ, numbers are not finite, or the orientations do not tell the unknowns apart: four, whose
        gravity directions do not lie in one plane of the sensor frame, are enough.
    """
    R_WS, wrenches = np.asarray(R_WS, dtype=float), np.asarray(wrenches, dtype=float)
    k = len(R_WS)
    if R_WS.shape != (k, 3, 3) or wrenches.shape != (k, 6):
        raise StateError(f"postures: {R_WS.shape} orientations do not go with {wrenches.shape} wrenches")
    if not (np.all(np.isfinite(R_WS)) and np.all(np.isfinite(wrenches))):
        raise StateError("postures: orientations or wrenches are not finite")
    g_S = np.einsum("kij,i->kj", R_WS, g_W)
    A = np.zeros((k, 6, 10))
    for row, (i, j) in enumerate(((1, 2), (2, 0), (0, 1))):  # τ = (m p) × g
        A[:, row, 1 + i], A[:, row, 1 + j] = g_S[:, j], -g_S[:, i]
    A[:, 3:, 0] = g_S
    A[:, np.arange(6), 4 + np.arange(6)] = 1.0
    rows = A.reshape(-1, 10)
    scaled = rows / np.maximum(np.linalg.norm(rows, axis=0), 1e-12)
    if k == 0 or np.linalg.svd(scaled, compute_uv=False)[-1] < 1e-3:
        raise StateError("postures: mass, centre of mass and bias cannot be told apart; turn the sensor farther")
    x = np.linalg.lstsq(rows, wrenches.ravel(), rcond=None)[0]
    if x[0] <= 0.0:
        raise StateError(f"postures: the readings give a mass of {x[0]:.3g} kg")
    error = wrenches - A @ x
    torque, force = (float(np.sqrt(np.mean(part**2))) for part in (error[:, :3], error[:, 3:]))
    tool = ToolParameters(float(x[0]), (x[1:4] / x[0]).tolist())
    return ToolIdentification(tool, np.array(x[4:], dtype=float), torque, force)


def main(arguments: Sequence[str] | None = None) -> None:
    """Identify the tool of a robot and print it."""
    parser = argparse.ArgumentParser(prog="identification", description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("robot", help="catalog name, or path of a URDF or SDF")
    parser.add_argument("readings", help="CSV: joint positions, moment and force of each posture")
    parser.add_argument("--joint", default="joint_7", help="joint whose load is measured (default: %(default)s)")
    options = parser.parse_args(arguments)
    try:
        robot = catalog.load(options.robot)
        link, X_LS, _ = sensor_mount(robot, options.joint)
        rows = np.loadtxt(options.readings, delimiter=",", ndmin=2)
        postures, wrenches = rows[:, : robot.n], rows[:, robot.n :]
        R_WL = [evaluate_dynamics(robot, q, np.zeros(robot.n)).R_WL[link] for q in postures]
        found = identify_tool(np.array(R_WL) @ X_LS.rotation().matrix(), wrenches, np.array(robot.tree.gravity))
    except (SaphariError, OSError, ValueError) as error:
        parser.error(str(error))
    print(f"mass: {found.tool.mass:.4f}  # kg\ncom: {np.round(found.tool.com, 4).tolist()}  # m, in S")
    print(f"# bias: {np.round(found.bias, 4).tolist()}  Nm, N")
    print(f"# left over, rms: {found.residual_torque:.2g} Nm, {found.residual_force:.2g} N")


if __name__ == "__main__":
    main()
