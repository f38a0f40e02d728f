"""Readers of the files that `force_recording` accepts: arrays by name; every defect is told with its place."""

from __future__ import annotations

import csv
import re
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from saphari_drake.errors import SensorError

Array = NDArray[np.float64]
COLUMNS = ("time", "fx", "fy", "fz")


def runs_of(file: Path) -> list[Mapping[str, Any]]:
    """Return the runs of a file, each as arrays by name; "rows" names the rows of a text file, such as "line 3".

    - CSV: "time" (T,), "force" (T, 3) and "rows".
    - NPZ: the arrays of the file.
    - MAT: the elements of the first struct array that has a field F, or the file's own arrays.
    """
    if not file.is_file():
        raise SensorError(f"{file}: no such file")
    readers = {".csv": _csv_runs, ".npz": _npz_runs, ".mat": _mat_runs}
    if file.suffix.lower() not in readers:
        raise SensorError(f"{file}: not a force recording; .csv, .npz and .mat are read")
    return readers[file.suffix.lower()](file)


def text_rows(file: Path) -> list[tuple[str, str]]:
    """Return the lines of a text file with their names, such as "line 3"; without comments (#) and empty ones."""
    text = file.read_text(encoding="utf-8-sig", errors="replace").splitlines()
    named = [(f"line {number}", line.split("#", 1)[0]) for number, line in enumerate(text, 1)]
    return [(name, line) for name, line in named if line.strip()]


def _csv_runs(file: Path) -> list[Mapping[str, Any]]:
    lines = text_rows(file)
    if not lines:
        raise SensorError(f"{file}: is empty")
    delimiter = max(",;\t", key=lines[0][1].count)
    rows = list(csv.reader([line for _, line in lines], delimiter=delimiter))
    names = [re.split(r"[\[(]", cell)[0].strip().lower() for cell in rows[0]]
    columns, width, first, wanted = [0, 1, 2, 3], 4, 0, ", ".join(COLUMNS)
    if not all(_is_number(cell) for cell in rows[0]):
        missing = [name for name in COLUMNS if name not in names]
        if missing:
            raise SensorError(f"{file}: no column {', '.join(missing)}; there are: {', '.join(names)}")
        columns, width, first, wanted = [names.index(name) for name in COLUMNS], len(names), 1, "as the header"
    labels, data = [label for label, _ in lines[first:]], []
    if not labels:
        raise SensorError(f"{file}: has a header and no rows")
    for label, row in zip(labels, rows[first:]):
        if len(row) != width:
            raise SensorError(f"{file}: {label} has {len(row)} columns, {width} are needed ({wanted})")
        for cell in (row[column] for column in columns):
            if not _is_number(cell):
                raise SensorError(f"{file}: {label}: '{cell.strip()}' is not a number")
            data.append(float(cell.strip() or "nan"))
    time, *force = np.array(data).reshape(-1, 4).T
    return [{"time": time, "force": np.array(force).T, "rows": labels}]


def _is_number(cell: str) -> bool:
    """Whether a cell is a number or empty (a missing reading)."""
    try:
        return float(cell.strip() or "nan") is not None
    except ValueError:
        return False


def _npz_runs(file: Path) -> list[Mapping[str, Any]]:
    try:
        with np.load(file, allow_pickle=False) as archive:
            return [{name: archive[name] for name in archive.files}]
    except (OSError, ValueError, EOFError, AttributeError, zipfile.BadZipFile) as error:
        raise SensorError(f"{file}: not an NPZ file ({error})") from error


def _mat_runs(file: Path) -> list[Mapping[str, Any]]:
    try:
        from scipy.io import loadmat
        from scipy.io.matlab import MatReadError
    except ImportError as error:
        raise SensorError(f"{file}: needs SciPy; install saphari_drake[matlab]") from error
    try:
        content = loadmat(file)
    except (MatReadError, NotImplementedError, ValueError, TypeError, OSError, EOFError, IndexError) as error:
        raise SensorError(f"{file}: not a MATLAB file that can be read ({error})") from error
    variables = {name: value for name, value in content.items() if not name.startswith("__")}
    for value in variables.values():
        names = value.dtype.names or ()
        if "F" in names:
            if value.size == 0:
                raise SensorError(f"{file}: the struct array is empty")
            return [{name: item[name] for name in names} for item in value.reshape(-1, order="F")]
    if "F" in variables:
        return [variables]
    found = [f"{n} ({', '.join(v.dtype.names)})" if v.dtype.names else n for n, v in variables.items()]
    raise SensorError(f"{file}: no struct array with a field F; there are: {', '.join(found) or 'none'}")
