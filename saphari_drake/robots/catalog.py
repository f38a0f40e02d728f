"""The robots that this project ships."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydrake.math import RigidTransform

from saphari_drake.errors import UnknownNameError
from saphari_drake.robots.attached import ModelOptions
from saphari_drake.robots.model import RobotModel


def models_dir() -> Path:
    """Return the folder of the shipped models: inside the installed package, or beside it in a checkout."""
    package = Path(str(files("saphari_drake")))
    installed = package / "models"
    return installed if installed.is_dir() else package.parent / "models"


def lwr4(X_WB: RigidTransform | None = None, home: ArrayLike = ()) -> RobotModel:
    """Return the KUKA LWR4+, 7 revolute joints, home with the elbow bent (sources in its URDF)."""
    return load("lwr4", X_WB, home)


def omnirob(X_WB: RigidTransform | None = None, home: ArrayLike = ()) -> RobotModel:
    """Return the KUKA omniRob, joints px, py, pz of its platform and a LWR4+ on top (sources in its URDF)."""
    return load("omnirob", X_WB, home)


def planar_6r(X_WB: RigidTransform | None = None, home: ArrayLike = ()) -> RobotModel:
    """Return the planar arm of Section 4, six unit links in the plane z = 0, home at (0, 0, 0, 0, 10, −30) deg."""
    return load("planar_6r", X_WB, home)


# Home postures of the shipped robots (deg; all joints that are not zero are revolute).
_HOME = {
    "lwr4": [0.0, -30.0, 0.0, 83.7, 0.0, 23.7, 0.0],
    "omnirob": [0.0, 0.0, 0.0, 0.0, -30.0, 0.0, 83.7, 0.0, 23.7, 0.0],
    "planar_6r": [0.0, 0.0, 0.0, 0.0, 10.0, -30.0],
}


# Nm and Nms/rad, friction reported for the joints of the LWR4, and the torque limits (Nm) of those joints.
REPORTED = {
    "coulomb": [11.9, 11.5, 8.98, 8.35, 8.31, 4.72, 6.04],
    "viscous": [14.4, 15.3, 6.55, 11.0, 4.29, 2.26, 1.6],
}
_TORQUE = [176.0, 176.0, 100.0, 100.0, 100.0, 38.0, 38.0]


def reported_friction(robot: RobotModel, name: str) -> NDArray[np.float64]:
    """Return the "coulomb" or "viscous" friction of the shipped LWR4, or as large a mean share of another's limits."""
    if robot.path == _file("lwr4") and robot.n == len(_TORQUE):
        return np.array(REPORTED[name])
    return np.asarray(np.mean(np.array(REPORTED[name]) / _TORQUE) * robot.tau_max)


def _file(name: str) -> Path:
    return models_dir() / name / f"{name}.urdf"


def load(
    name_or_path: str,
    X_WB: RigidTransform | None = None,
    home: ArrayLike = (),
    options: ModelOptions | None = None,
) -> RobotModel:
    """Return a shipped robot by its name, or any robot by the path of its URDF, SDF or MJCF.

    Parameters
    ----------
    name_or_path : str
    X_WB : RigidTransform, optional
        Pose of its root in the world.
    home : (n,) array, optional
        Home posture (rad or m) in place of its own.
    options : ModelOptions, optional
        Which of its joints move, their limits, a tool, a load.

    Raises
    ------
    UnknownNameError
        If it is neither; the message lists the shipped ones.
    ModelError, StateError
        If the file cannot be used, or `home` has another size.
    """
    posture: ArrayLike | None = home if np.size(home) else None
    path, more = Path(name_or_path), options or ModelOptions()
    if name_or_path in _HOME:
        path = _file(name_or_path)
        if posture is None and not more.joints:
            posture = np.deg2rad(_HOME[name_or_path])
    elif path.suffix.lower() not in (".urdf", ".sdf", ".xml"):
        raise UnknownNameError("robot", name_or_path, [*_HOME, "or the path of a .urdf, .sdf or .xml file"])
    return RobotModel(
        path,
        X_WB=X_WB,
        home=posture,
        effort_limits=more.effort_limits or None,
        velocity_limits=more.velocity_limits or None,
        joints=more.joints,
        attached=(more.tool, more.payload),
        package_dirs=more.package_dirs,
    )
