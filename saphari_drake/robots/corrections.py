"""What an identification found of one arm: its friction, payload and inertias, and the model that knows them."""

from copy import copy
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pydrake.common.yaml import yaml_dump_typed, yaml_load_typed

from saphari_drake.errors import ParameterError
from saphari_drake.math.tree import Tree
from saphari_drake.parameters import require_non_negative, require_vector
from saphari_drake.robots.model import RobotModel

Array = NDArray[np.float64]


@dataclass
class RobotCorrections:
    """Found by `diagrams/identify.py`. An empty list leaves what the model file says."""

    # Nm (N), Coulomb friction of each joint, and Nms/rad (Ns/m), viscous.
    coulomb: list[float] = field(default_factory=list)
    viscous: list[float] = field(default_factory=list)
    # Nm (N); constant error of each drive: it gives so much more than it is asked for.
    bias: list[float] = field(default_factory=list)
    # kg m² (kg); reflected inertia of each motor.
    rotor_inertia: list[float] = field(default_factory=list)
    # Mass and inertia of each link over those of the file.
    link_scale: list[float] = field(default_factory=list)
    # kg, and m in the last link's frame; payload and its centre of mass.
    payload: float = 0.0
    payload_centre: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])

    def __post_init__(self) -> None:
        require_non_negative(self, "coulomb", "viscous", "rotor_inertia", "link_scale", "payload")
        require_vector(self, len(self.bias), "bias")
        require_vector(self, 3, "payload_centre")

    @classmethod
    def read(cls, path: str | Path) -> "RobotCorrections":
        """Read a YAML file; `ParameterError` if there is none, or it does not hold these fields."""
        if not Path(path).is_file():
            raise ParameterError("identified", f"no file '{path}'")
        try:
            found = yaml_load_typed(schema=cls, filename=str(path), defaults=cls())
        except (RuntimeError, ValueError, OSError) as error:
            raise ParameterError(str(path), f"holds no corrections of a robot: {error}") from error
        found.__post_init__()
        return found

    def text(self) -> str:
        """Return it as YAML."""
        return str(yaml_dump_typed(self))


def corrected(robot: RobotModel, found: RobotCorrections) -> RobotModel:
    """Return the robot as its controllers may know it after an identification: with other inertias and a payload.

    What is simulated is still what the file says: `RobotModel.add_to` does not change. Friction and bias are for
    observers.

    Raises
    ------
    ParameterError
        If a list has another number of entries than the robot has joints.
    """

    def listed(name: str, default: Array) -> Array:
        values = np.array(getattr(found, name), dtype=float)
        if values.shape not in ((0,), (robot.n,)):
            raise ParameterError(name, f"{robot.name} has {robot.n} joints, got {len(values)} entries")
        return values if values.size else default

    tree, scale = robot.file_tree, listed("link_scale", np.ones(robot.n))
    tree = tree._replace(
        mass=scale * tree.mass,
        inertia=scale[:, None, None] * tree.inertia,
        armature=listed("rotor_inertia", tree.armature),
    )
    other = copy(robot)
    other.tree = with_payload(tree, found.payload, np.array(found.payload_centre))
    return other


def with_payload(tree: Tree, payload: float, p: Array, radius: float = 0.0) -> Tree:
    """Return a tree with a ball of so many kg, centre `p` (m) and radius (m) on the last link."""
    if payload == 0.0:
        return tree
    mass, com, inertia = tree.mass.copy(), tree.com.copy(), tree.inertia.copy()
    apart, total = p - com[-1], mass[-1] + payload
    about = np.dot(apart, apart) * np.eye(3) - np.outer(apart, apart)
    inertia[-1] += mass[-1] * payload / total * about + 0.4 * payload * radius**2 * np.eye(3)
    mass[-1], com[-1] = total, com[-1] + payload / total * apart
    return tree._replace(mass=mass, com=com, inertia=inertia)
