"""Calibration of a skin patch: from what an indenter presses and the cells read, to forces of the modules."""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path
from zipfile import BadZipFile

import numpy as np
from numpy.typing import ArrayLike, NDArray

from saphari_drake.errors import SensorError, StateError
from saphari_drake.perception.skin.layout import CELLS, OPPOSITE, SkinLayout, neighbour_table

Array = NDArray[np.float64]

VERSION = 1
TERMS = 14  # 4 linear and 10 quadratic ones
_FIRST, _SECOND = np.triu_indices(CELLS)


@dataclass(frozen=True)
class IndenterData:
    """Presses on a patch, one module at a time.

    Attributes
    ----------
    module : (p,) int array
        Module that was pressed.
    f_M : (p, 3) array
        Force on it, in its own frame (N).
    voltages : (p, 9, 4) array
        What the cells of that module and of its neighbours read (V), see `neighbour_table`; NaN where there is none.
    rest : (m, 4) array
        What they read without load (V).
    limits : (2,) array
        Range of the converter (V).
    """

    module: NDArray[np.int64]
    f_M: Array
    voltages: Array
    rest: Array
    limits: Array

    def require_fits(self, m: int) -> None:
        """Raise `StateError` unless the sizes belong to a patch of `m` modules and the forces are finite."""
        p = len(self.module)
        for name, shape in {"f_M": (p, 3), "voltages": (p, 9, CELLS), "rest": (m, CELLS), "limits": (2,)}.items():
            value: ArrayLike = getattr(self, name)
            if np.shape(value) != shape:
                raise StateError(f"indenter data: {name} has shape {np.shape(value)}; {shape} is needed")
        if not np.all(np.isfinite(self.f_M)):
            raise StateError("indenter data: f_M is not finite")
        if np.any((self.module < 0) | (self.module >= m)):
            raise StateError(
                f"indenter data: modules {np.min(self.module)} to {np.max(self.module)}; 0 to {m - 1} exist"
            )


@dataclass(frozen=True)
class SkinCalibration:
    """What turns voltages of a patch into forces of its modules.

    Attributes
    ----------
    identity : (4,) array
        Of the layout it belongs to.
    offset : (m, 4) array
        V₀ (V).
    inverse : (m, 3, 14) array
        Force of a module over linear and quadratic terms of V − V₀ (N/V, N/V²).
    coupling : (m, 8, 3, 3) array
        Force that a module seems to feel for that of each neighbour, see `neighbour_table`.
    dead : (k,) int array
        Modules without response.
    rms, worst : (m,) arrays
        Error of the force over the presses of each module (N); NaN for dead ones.
    limits : (2,) array
        Range of the converter (V).
    largest : float
        Largest force pressed (N); beyond it, the calibration extrapolates.
    """

    identity: Array
    offset: Array
    inverse: Array
    coupling: Array
    dead: NDArray[np.int64]
    rms: Array
    worst: Array
    limits: Array
    largest: float

    def save(self, path: str | Path) -> None:
        """Write it to a file (.npz)."""
        with Path(path).open("wb") as file:
            np.savez(file, version=VERSION, **{item.name: getattr(self, item.name) for item in fields(self)})

    @classmethod
    def load(cls, path: str | Path, layout: SkinLayout) -> SkinCalibration:
        """Read it from a file.

        Raises
        ------
        SensorError
            If there is no such file, it is no calibration, is of another version or layout, or holds bad numbers.
        """
        path = Path(path)
        try:
            with np.load(path) as file:
                content = dict(file)
        except (OSError, ValueError, EOFError, BadZipFile) as error:
            raise SensorError(f"{path}: cannot be read as a skin calibration: {error}") from error
        names = [item.name for item in fields(cls)]
        missing = [name for name in ("version", *names) if name not in content]
        if missing:
            raise SensorError(f"{path}: no skin calibration, lacks {', '.join(missing)}")
        if int(content["version"]) != VERSION:
            raise SensorError(f"{path}: version {int(content['version'])}; version {VERSION} is needed")
        calibration = cls(
            **{name: content[name] for name in names if name != "largest"}, largest=float(content["largest"])
        )
        calibration.require_fits(layout, str(path))
        return calibration

    def require_fits(self, layout: SkinLayout, what: str = "calibration") -> None:
        """Raise `SensorError` unless it belongs to the layout and its numbers are finite."""
        if self.identity.shape != (4,) or not np.allclose(self.identity, layout.identity, rtol=1e-6):
            own, given = (_told(identity) for identity in (self.identity, layout.identity))
            raise SensorError(f"{what}: belongs to a skin of {own}; this one has {given}")
        m = layout.count
        shapes = {
            "offset": (m, CELLS),
            "inverse": (m, 3, TERMS),
            "coupling": (m, 8, 3, 3),
            "rms": (m,),
            "worst": (m,),
            "limits": (2,),
        }
        for name, shape in shapes.items():
            if getattr(self, name).shape != shape:
                raise SensorError(f"{what}: {name} has shape {getattr(self, name).shape}; {shape} is needed")
        for name in ("offset", "inverse", "coupling", "limits"):
            if not np.all(np.isfinite(getattr(self, name))):
                raise SensorError(f"{what}: {name} is not finite")
        if np.any((self.dead < 0) | (self.dead >= m)):
            raise SensorError(f"{what}: dead modules {self.dead.tolist()}; the patch has 0 to {m - 1}")

    def report(self) -> str:
        """Return a table of the error of each module."""
        errors = zip(self.rms, self.worst)
        rows = [f"module {i:4d}  rms {rms:6.3f} N  worst {worst:6.3f} N" for i, (rms, worst) in enumerate(errors)]
        for i in self.dead:
            rows[i] = f"module {i:4d}  dead"
        alive = np.setdiff1d(np.arange(len(self.rms)), self.dead)
        if len(alive):
            worst = alive[np.argmax(self.rms[alive])]
            median = np.median(self.rms[alive])
            rows.append(f"median rms {median:.3f} N; worst is module {worst} with {self.rms[worst]:.3f} N")
        rows.append(f"{len(self.dead)} dead")
        return "\n".join(rows)


def _told(identity: Array) -> str:
    if identity.shape != (4,):
        return f"shape {identity.shape}"
    rows, columns, pitch, curvature = identity
    return f"{rows:.0f} × {columns:.0f} modules, {1e3 * pitch:.2f} mm apart, curvature {curvature:.2f}/m"


def features(dv: Array) -> Array:
    """Return linear and quadratic terms (…, 14) of V − V₀ (…, 4)."""
    return np.concatenate([dv, dv[..., _FIRST] * dv[..., _SECOND]], axis=-1)


def calibrate(layout: SkinLayout, data: IndenterData, least_response: float = 0.01) -> SkinCalibration:
    """Fit a calibration to indenter data, in two steps.

    First each module by itself: F = A ψ(V − V₀) over its own presses, ψ linear and quadratic terms with their cross
    terms, by least squares weighted with 1/(1 N + |F|). Then the crosstalk: what its neighbours seem to feel meanwhile
    is linear in F, because ψ has taken out the curvature.

    Parameters
    ----------
    layout : SkinLayout
    data : IndenterData
    least_response : float
        A module is dead if its cells respond with less (V/N), or not with finite voltages.

    Raises
    ------
    StateError
        If the data do not fit the layout, or a module that responds was pressed fewer than 30 times.
    """
    m = layout.count
    data.require_fits(m)
    dv = data.voltages[:, 0] - data.rest[data.module]
    margin = 0.01 * (data.limits[1] - data.limits[0])
    limits = data.limits + np.array([margin, -margin])
    inverse, rms, worst = np.zeros((m, 3, TERMS)), np.full(m, np.nan), np.full(m, np.nan)
    dead = []
    for i in range(m):
        own = data.module == i
        f_M, response = data.f_M[own], dv[own]
        size = np.linalg.norm(f_M, axis=1)
        if not (np.all(np.isfinite(response)) and np.all(np.isfinite(data.rest[i]))):
            dead.append(i)
            continue
        if len(size) < 30:
            raise StateError(f"indenter data: module {i} was pressed {len(size)} times; 30 are needed")
        if np.median(np.abs(response).max(axis=1) / np.maximum(size, 1e-9)) < least_response:
            dead.append(i)
            continue
        inside = np.all((response + data.rest[i] > limits[0]) & (response + data.rest[i] < limits[1]), axis=1)
        f_M, response, size = f_M[inside], response[inside], size[inside]
        weight = (1.0 / (1.0 + size))[:, None]
        psi = features(response)
        inverse[i] = np.linalg.lstsq(weight * psi, weight * f_M, rcond=1e-10)[0].T
        error = np.linalg.norm(psi @ inverse[i].T - f_M, axis=1)
        rms[i], worst[i] = np.sqrt(np.mean(error**2)), error.max()
    coupling = _fit_coupling(layout, data, inverse, dead)
    offset = np.where(np.isfinite(data.rest), data.rest, 0.0)
    largest = float(np.abs(data.f_M[:, 2]).max())
    return SkinCalibration(
        layout.identity, offset, inverse, coupling, np.array(dead, dtype=np.int64), rms, worst, data.limits, largest
    )


def _fit_coupling(layout: SkinLayout, data: IndenterData, inverse: Array, dead: list[int]) -> Array:
    """Regress what each neighbour of a pressed module seems to feel on the force, (m, 8, 3, 3)."""
    coupling = np.zeros((layout.count, 8, 3, 3))
    table = neighbour_table(layout.rows, layout.columns)
    for i in range(layout.count):
        if i in dead:
            continue
        for k, j in enumerate(table[i]):
            pressed = data.module == j
            if j < 0 or not np.any(pressed):
                continue
            felt = features(data.voltages[pressed, 1 + OPPOSITE[k]] - data.rest[i]) @ inverse[i].T
            coupling[i, k] = np.linalg.lstsq(data.f_M[pressed], felt, rcond=None)[0].T
    return coupling
