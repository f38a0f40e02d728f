"""Stopping times and distances of a robot, measured and stored beside its model."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pydrake.common.yaml import yaml_dump_typed, yaml_load_typed

from saphari_drake.errors import ModelError, ParameterError
from saphari_drake.robots.model import RobotModel

Array = NDArray[np.float64]
FILE = "stopping.yaml"
EXTENSIONS = (1.0 / 3.0, 2.0 / 3.0, 1.0)  # as ISO 10218 asks for


@dataclass
class StoppingTable:
    """Worst stopping times and distances over speed, for each third of the reach; made by `diagrams/stopping.py`."""

    # How it was made: of which robot, in how many stops, with what.
    about: str = ""
    # m; horizontal distance of the farthest shape from the first axis that moves the arm, fully stretched.
    reach: float = 1.0
    # m/s, of the fastest end of a shape, rising from 0.
    speed: list[float] = field(default_factory=lambda: [0.0, 1.0])
    # s and m, one row an extension up to 1/3, 2/3 and all of the reach; way of the fastest end. No stop that was
    # measured lies above the line through them, which holds a margin.
    time: list[list[float]] = field(default_factory=lambda: [[0.0, 0.0]] * 3)
    distance: list[list[float]] = field(default_factory=lambda: [[0.0, 0.0]] * 3)

    def __post_init__(self) -> None:
        size = (len(EXTENSIONS), len(self.speed))
        if not self.reach > 0.0:
            raise ParameterError("reach", f"must be positive, got {self.reach}")
        if size[1] < 2 or self.speed[0] != 0.0 or not np.all(np.diff(self.speed) > 0.0):
            raise ParameterError("speed", f"must rise from 0, got {self.speed}")
        for name in ("time", "distance"):
            rows = np.asarray(getattr(self, name), dtype=float)
            if rows.shape != size or not np.all(rows >= 0.0):
                raise ParameterError(name, f"needs {size[0]} rows of {size[1]} numbers ≥ 0, got shape {rows.shape}")

    def row(self, extension: float) -> tuple[Array, Array, Array]:
        """Return speeds, times and distances (k,) at a share of the reach."""
        k = min(int(np.searchsorted(EXTENSIONS, extension - 1e-9)), len(EXTENSIONS) - 1)
        return np.array(self.speed), np.array(self.time[k]), np.array(self.distance[k])

    def text(self) -> str:
        """Return it as the text of a file."""
        return str(yaml_dump_typed(self))


def extension_of(p_WS: Array, p_axis: Array, reach: float) -> float:
    """Return the share of the reach at which the farthest of the points (s, 3) is, horizontally."""
    away = np.asarray(p_WS)[:, :2] - np.asarray(p_axis)[:2]
    return float(np.sqrt(np.max(np.sum(away * away, axis=1)))) / reach


def read_stopping(path: str | Path) -> StoppingTable:
    """Read a table that `diagrams/stopping.py` made.

    Raises
    ------
    ParameterError
        If the file does not hold such a table.
    """
    try:
        table: StoppingTable = yaml_load_typed(schema=StoppingTable, filename=str(path))
        table.__post_init__()
    except (RuntimeError, ValueError, TypeError, AssertionError) as error:
        raise ParameterError(str(path), f"no table of stopping times: {str(error).splitlines()[0]}") from error
    return table


def stopping_of(robot: RobotModel) -> StoppingTable:
    """Return the table stored beside a robot's model file.

    Raises
    ------
    ModelError
        If there is none.
    """
    path = robot.path.with_name(FILE)
    if not path.is_file():
        raise ModelError(f"{robot.name}: no {FILE} beside {robot.path.name}; diagrams/stopping.py measures it")
    return read_stopping(path)
