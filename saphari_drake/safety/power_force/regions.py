"""Limits of the regions of the body, as a file holds them and as the law takes them."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.common.yaml import yaml_load_typed

from saphari_drake.errors import ParameterError, UnknownNameError
from saphari_drake.parameters import require_non_negative, require_positive

Array = NDArray[np.float64]
FILE = Path(__file__).with_name("body_regions.yaml")
HEAD = ("skull", "face")


@dataclass
class BodyRegion:
    """Limits of one region of the body; check them against a licensed copy of the standard."""

    # N, quasi-static, as when the region is clamped.
    force: float = 140.0
    # Factor on it in a free contact; 0: no contact is allowed.
    transient: float = 2.0
    # N/m, of the contact, and kg, that moves with it.
    stiffness: float = 75.0e3
    mass: float = 0.6
    # m; what is within it beyond the surface clamps the region.
    thickness: float = 0.03
    # J, of a free contact; 0: (transient · force)² / (2 stiffness).
    energy: float = 0.0

    def __post_init__(self) -> None:
        require_positive(self, "force", "stiffness", "mass", "thickness")
        require_non_negative(self, "transient", "energy")

    @property
    def energy_free(self) -> float:
        """Energy that a free contact may have (J)."""
        if self.transient == 0.0:
            return 0.0
        elastic = (self.transient * self.force) ** 2 / (2.0 * self.stiffness)
        return min(self.energy, elastic) if self.energy > 0.0 else elastic

    @property
    def energy_clamped(self) -> float:
        """Energy that a contact may have whose region cannot give way (J)."""
        return 0.0 if self.transient == 0.0 else self.force**2 / (2.0 * self.stiffness)


@dataclass
class _File:
    regions: dict[str, BodyRegion] = field(default_factory=dict)


class Limits(NamedTuple):
    """Limits of several regions as arrays (k,)."""

    free: Array  # J
    clamped: Array  # J
    mass: Array  # kg


def read_regions(path: str | Path = "") -> dict[str, BodyRegion]:
    """Return the regions of a file by name; default: those of this library.

    Raises
    ------
    ParameterError
        If the file cannot be read as such, or a number cannot be used.
    """
    path = Path(path) if path else FILE
    try:
        regions: dict[str, BodyRegion] = yaml_load_typed(schema=_File, filename=str(path)).regions
    except (RuntimeError, ValueError, TypeError, AssertionError) as error:
        raise ParameterError(str(path), f"no regions of the body: {str(error).splitlines()[0]}") from error
    for name, region in regions.items():
        try:
            region.__post_init__()
        except ParameterError as error:
            raise ParameterError(f"{path}: {name}.{error.field}", "must be positive") from error
    return regions


def limits_of(regions: dict[str, BodyRegion], names: list[str]) -> Limits:
    """Return the limits of the named regions.

    Raises
    ------
    UnknownNameError
        If one of them is not there.
    """
    for name in names:
        if name not in regions:
            raise UnknownNameError("region of the body", name, regions)
    rows = [(regions[name].energy_free, regions[name].energy_clamped, regions[name].mass) for name in names]
    return Limits(*(np.ascontiguousarray(column, dtype=float) for column in np.array(rows).reshape(-1, 3).T))
