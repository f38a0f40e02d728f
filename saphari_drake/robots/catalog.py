"""The robots that this project ships."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path

import numpy as np
from pydrake.math import RigidTransform

from saphari_drake.errors import UnknownNameError
from saphari_drake.robots.model import RobotModel


def models_dir() -> Path:
    """Return the folder of the shipped models: inside the installed package, or beside it in a checkout."""
    package = Path(str(files("saphari_drake")))
    installed = package / "models"
    return installed if installed.is_dir() else package.parent / "models"


def lwr4(X_WB: RigidTransform | None = None) -> RobotModel:
    """Return the KUKA LWR4+, 7 revolute joints, home with the elbow bent (sources in its URDF)."""
    home = np.deg2rad([0.0, -30.0, 0.0, 83.7, 0.0, 23.7, 0.0])
    return RobotModel(models_dir() / "lwr4" / "lwr4.urdf", X_WB=X_WB, home=home)


def omnirob(X_WB: RigidTransform | None = None) -> RobotModel:
    """Return the KUKA omniRob, joints px, py, pz of its platform and a LWR4+ on top (sources in its URDF)."""
    home = np.concatenate([np.zeros(3), np.deg2rad([0.0, -30.0, 0.0, 83.7, 0.0, 23.7, 0.0])])
    return RobotModel(models_dir() / "omnirob" / "omnirob.urdf", X_WB=X_WB, home=home)


def planar_6r(X_WB: RigidTransform | None = None) -> RobotModel:
    """Return the planar arm of Section 4, six unit links in the plane z = 0, home at (0, 0, 0, 0, 10, −30) deg."""
    home = np.deg2rad([0.0, 0.0, 0.0, 0.0, 10.0, -30.0])
    return RobotModel(models_dir() / "planar_6r" / "planar_6r.urdf", X_WB=X_WB, home=home)


CATALOG = {"lwr4": lwr4, "omnirob": omnirob, "planar_6r": planar_6r}


def load(name_or_path: str, X_WB: RigidTransform | None = None) -> RobotModel:
    """Return a shipped robot by its name, or any robot by the path of its URDF or SDF."""
    if name_or_path in CATALOG:
        return CATALOG[name_or_path](X_WB)
    if Path(name_or_path).suffix.lower() in (".urdf", ".sdf", ".xml"):
        return RobotModel(name_or_path, X_WB=X_WB)
    raise UnknownNameError("robot", name_or_path, [*CATALOG, "or the path of a .urdf or .sdf file"])
