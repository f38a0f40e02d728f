"""Log: what was recorded in one run, as named arrays with units on one time axis."""

from __future__ import annotations

import json
import zipfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from saphari_drake.errors import ParameterError, SensorError, UnknownNameError
from saphari_drake.simulation.record.files import atomic_path

Array = NDArray[np.float64]

RESERVED = ("time", "units")


class Log:
    """Named signals of one run.

    Parameters
    ----------
    time : (T,) array
        Sample times (s), increasing.

    Attributes
    ----------
    units : dict of str
        Unit of each signal; "" where it has none.

    Examples
    --------
    >>> log = Log([0.0, 0.1])
    >>> log.add("force", [[0.0, 0.0, 1.0], [0.0, 0.0, 2.0]], "N")
    >>> log["force"].shape
    (2, 3)
    """

    def __init__(self, time: ArrayLike) -> None:
        self.time: Array = np.asarray(time, dtype=float).reshape(-1)
        if self.time.size > 1 and not np.all(np.diff(self.time) > 0.0):
            raise ParameterError("time", "must increase from sample to sample")
        self.units: dict[str, str] = {}
        self._signals: dict[str, Array] = {}

    def add(self, name: str, values: ArrayLike, unit: str = "") -> None:
        """Add a signal, (T,) or (T, k); an existing one of this name is replaced."""
        array = np.asarray(values, dtype=float)
        if name in RESERVED:
            raise ParameterError(name, "this name is taken by the log itself")
        if array.ndim == 1:
            array = array[:, None]
        if array.ndim != 2 or array.shape[0] != self.time.size:
            raise ParameterError(name, f"needs {self.time.size} rows, one a sample, got shape {np.shape(values)}")
        self._signals[name], self.units[name] = array, unit

    def __getitem__(self, name: str) -> Array:
        """Return a signal as a (T, k) array."""
        if name not in self._signals:
            raise UnknownNameError("signal", name, self._signals)
        return self._signals[name]

    def __contains__(self, name: object) -> bool:
        return name in self._signals

    def __iter__(self) -> Iterator[str]:
        return iter(self._signals)

    def __len__(self) -> int:
        return len(self._signals)

    def between(self, start: float, end: float) -> NDArray[np.bool_]:
        """Return a (T,) mask of the samples with start ≤ time ≤ end (s)."""
        return (self.time >= start) & (self.time <= end)

    def save(self, path: str | Path) -> None:
        """Write an NPZ file: ``time``, one array a signal, and ``units``, a JSON object from name to unit."""
        units = json.dumps({"time": "s", **self.units}, ensure_ascii=False)
        with atomic_path(path) as temporary, temporary.open("wb") as file:
            # Arrays by keyword cannot be used: a signal may be called "file".
            with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
                for name, array in {"time": self.time, **self._signals, "units": np.array(units)}.items():
                    with archive.open(f"{name}.npy", "w", force_zip64=True) as entry:
                        np.lib.format.write_array(entry, np.asarray(array), allow_pickle=False)

    @classmethod
    def load(cls, path: str | Path) -> Log:
        """Read a file written by `save`.

        Raises
        ------
        SensorError
            If the file is missing or is no such log.
        """
        try:
            with np.load(path, allow_pickle=False) as archive:
                units = json.loads(str(archive["units"]))
                log = cls(archive["time"])
                for name in archive.files:
                    if name not in RESERVED:
                        log.add(name, archive[name], units.get(name, ""))
        except (OSError, ValueError, KeyError, zipfile.BadZipFile, AttributeError) as error:
            raise SensorError(f"{path}: not a log ({error})") from error
        return log
