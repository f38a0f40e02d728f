"""Readers of the files that `force_recording` accepts; every defect is told with the file and the place in it."""

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


def file_kind(file: Path) -> str:
    """Return the suffix of a file that exists and is one of those read."""
    if not file.is_file():
        raise SensorError(f"{file}: no such file")
    kind = file.suffix.lower()
    if kind not in (".csv", ".npz", ".mat"):
        raise SensorError(f"{file}: not a force recording; .csv, .npz and .mat are read")
    return kind


def read_csv(file: Path) -> tuple[Array, Array, list[str]]:
    """Return times (T,), forces (T, 3) and the name of each row, such as "line 3"."""
    text = file.read_text(encoding="utf-8-sig", errors="replace").splitlines()
    numbered = [(i, line) for i, line in enumerate(text, 1) if line.strip() and not line.lstrip().startswith("#")]
    if not numbered:
        raise SensorError(f"{file}: is empty")
    delimiter = max(",;\t", key=numbered[0][1].count)
    rows = list(csv.reader([line for _, line in numbered], delimiter=delimiter))
    names = [re.split(r"[\[(]", cell)[0].strip().lower() for cell in rows[0]]
    columns, width, first = [0, 1, 2, 3], 4, 0
    if not all(_is_number(cell) for cell in rows[0]):
        missing = [name for name in COLUMNS if name not in names]
        if missing:
            raise SensorError(f"{file}: no column {', '.join(missing)}; there are: {', '.join(names)}")
        columns, width, first = [names.index(name) for name in COLUMNS], len(names), 1
    labels = [f"line {number}" for number, _ in numbered[first:]]
    if not labels:
        raise SensorError(f"{file}: has a header and no rows")
    data = np.empty((len(labels), 4))
    for k, (label, row) in enumerate(zip(labels, rows[first:])):
        if len(row) != width:
            wanted = "time, fx, fy, fz" if first == 0 else "as the header"
            raise SensorError(f"{file}: {label} has {len(row)} columns, {width} are needed ({wanted})")
        for i, column in enumerate(columns):
            if not _is_number(row[column]):
                raise SensorError(f"{file}: {label}: '{row[column].strip()}' is not a number")
            data[k, i] = float(row[column]) if row[column].strip() else np.nan
    return data[:, 0], data[:, 1:], labels


def _is_number(cell: str) -> bool:
    """Whether a cell is a number or empty (a missing reading)."""
    try:
        return not cell.strip() or float(cell) is not None
    except ValueError:
        return False


def read_npz(file: Path) -> tuple[Array, Array]:
    """Return times (T,) and forces (T, 3)."""
    try:
        with np.load(file, allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
    except (OSError, ValueError, EOFError, AttributeError, zipfile.BadZipFile) as error:
        raise SensorError(f"{file}: not an NPZ file ({error})") from error
    missing = [name for name in ("time", "force") if name not in arrays]
    if missing:
        raise SensorError(f"{file}: no array {', '.join(missing)}; there are: {', '.join(arrays) or 'none'}")
    return numbers(file, "time", arrays["time"]).reshape(-1), by_rows(file, "force", arrays["force"])


def mat_runs(file: Path) -> list[Mapping[str, Any]]:
    """Return the elements of the first struct array that has a field F, or the file's own arrays as one run."""
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
        names = getattr(value.dtype, "names", None) or ()
        if "F" in names:
            if value.size == 0:
                raise SensorError(f"{file}: the struct array is empty")
            return [{name: item[name] for name in names} for item in value.reshape(-1, order="F")]
    if "F" in variables:
        return [variables]
    found = [f"{n} ({', '.join(v.dtype.names)})" if v.dtype.names else n for n, v in variables.items()]
    raise SensorError(f"{file}: no struct array with a field F; there are: {', '.join(found) or 'none'}")


def numbers(file: Path, name: str, value: Any) -> Array:
    """Return a value of the file as an array of numbers."""
    try:
        return np.asarray(value, dtype=np.float64)
    except (ValueError, TypeError) as error:
        raise SensorError(f"{file}: {name} does not hold numbers") from error


def by_rows(file: Path, name: str, value: Any) -> Array:
    """Return a (T, 3) array from (3, T) or (T, 3); a square one is taken as (3, T) for MATLAB's F, pos and vel."""
    array = numbers(file, name, value)
    if array.size == 0:
        raise SensorError(f"{file}: {name} is empty")
    if array.ndim != 2 or 3 not in array.shape:
        raise SensorError(f"{file}: {name} has shape {array.shape}, three components are needed")
    if array.shape == (3, 3):
        return array if name == "force" else array.T
    return array if array.shape[1] == 3 else array.T
