"""From voltages of a skin to contacts: forces of the modules, patches of pressure, a bell fitted to each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from saphari_drake.errors import ParameterError
from saphari_drake.math.skin_fit import fit_bells
from saphari_drake.math.skin_kernels import module_forces, pressure_peaks
from saphari_drake.parameters import require_non_negative, require_positive
from saphari_drake.perception.skin_calibration import SkinCalibration
from saphari_drake.perception.skin_layout import SkinLayout
from saphari_drake.perception.skin_modules import neighbour_table
from saphari_drake.port_values import SkinContact

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass
class SkinContactParameters:
    """What counts as a contact; A."""

    # N; a module below it carries nothing, > 0. Five deviations of its noise.
    module_threshold: float = 0.12
    # N; forces at which a contact begins and ends, > 0.
    touch_force: float = 0.6
    release_force: float = 0.35
    # Share of the lower of two peaks by which it must rise above the pass between them to be a contact of its own, 0–1.
    prominence: float = 0.15
    # m; a contact this near one of the sample before goes on with it.
    travel: float = 0.01
    # Usual and least width (standard deviation) of a bell in pitches, and weight of the pull to the usual one.
    usual_width: float = 0.45
    least_width: float = 0.12
    width_weight: float = 0.02
    # Rounds of the crosstalk's solution, and most rounds of the fit.
    crosstalk_rounds: int = 6
    fit_rounds: int = 15

    def __post_init__(self) -> None:
        require_positive(
            self, "module_threshold", "touch_force", "release_force", "travel", "usual_width", "least_width",
            "crosstalk_rounds", "fit_rounds",
        )  # fmt: skip
        require_non_negative(self, "width_weight", "prominence")
        if self.prominence > 1.0:
            raise ParameterError("prominence", f"must not exceed 1, got {self.prominence}")
        if self.release_force > self.touch_force:
            raise ParameterError("release_force", f"must not exceed touch_force, got {self.release_force}")


class Bells(NamedTuple):
    """Contacts in surface coordinates."""

    centre: Array  # (K, 2), m
    width: Array  # (K,), m
    force: Array  # (K, 3), N, link frame


class SkinContactLaw:
    """Turns voltages over the baseline into contacts.

    1. Forces of the modules by the calibration, crosstalk removed, (m, 3) in their own frames.
    2. Patches of pressure: connected modules above a threshold, divided where two peaks rise above the pass between.
    3. A Gaussian bell (middle, width, force vector) fitted to each patch, neighbours together: F_i ≈ Σ_k B_ik f_k.
    4. F = Σ R_i F_i over the modules that work, and the bell's share of what dead modules and the ground beside the
       patch carry; the contact point is the bell's middle, where the force-weighted centroid would lie without gaps.

    Parameters
    ----------
    layout : SkinLayout
    calibration : SkinCalibration
    params : SkinContactParameters, optional

    Raises
    ------
    SensorError
        If the calibration does not belong to the layout.
    """

    def __init__(
        self, layout: SkinLayout, calibration: SkinCalibration, params: SkinContactParameters | None = None
    ) -> None:
        calibration.require_fits(layout)
        self.layout, self.calibration, self.params = layout, calibration, params or SkinContactParameters()
        self.neighbours = neighbour_table(layout.rows, layout.columns)
        self._compile()

    def _compile(self) -> None:
        uv = self.layout.uv
        load = 5.0 * np.exp(-0.5 * np.sum(uv**2, axis=1) / self.layout.pitch**2)
        usable = np.ones(self.layout.count, dtype=bool)
        self.forces(np.zeros((self.layout.count, 4)), usable)
        self.bells(-load[:, None] * np.array([0.0, 0.0, 1.0]), usable)

    def forces(self, dv: Array, usable: Mask) -> Array:
        """Return the force on each module (m, 3), N, in its own frame; unusable ones get the mean of those around.

        Parameters
        ----------
        dv : (m, 4) array
            Voltages over the baseline (V).
        usable : (m,) bool array
        """
        f_M = np.empty((self.layout.count, 3))
        c = self.calibration
        module_forces(dv, c.inverse, c.coupling, self.neighbours, usable, int(self.params.crosstalk_rounds), f_M)
        return f_M

    def bells(self, f_M: Array, usable: Mask) -> Bells:
        """Return the contacts that explain the modules' forces, without regard to how weak they are."""
        layout, params = self.layout, self.params
        label = np.empty(layout.count, dtype=np.int64)
        pressure = -f_M[:, 2]
        count = pressure_peaks(pressure, self.neighbours, params.module_threshold, params.prominence, label)
        f_L = np.einsum("mij,mj->mi", layout.R_LM, f_M)
        centre, width, force = (
            np.empty((count, 2)),
            np.full(count, params.usual_width * layout.pitch),
            np.empty((count, 3)),
        )
        for k in range(count):
            own = label == k
            centre[k] = pressure[own] @ layout.uv[own] / pressure[own].sum()
            force[k] = f_L[own].sum(axis=0)
        for group in self._groups(centre):
            self._fit(f_L, usable, centre, width, force, group)
        return Bells(centre, width, force)

    def _groups(self, centre: Array) -> list[list[int]]:
        """Return contacts whose bells may overlap, together."""
        reach = 5.0 * self.layout.pitch
        groups: list[list[int]] = []
        for k in range(len(centre)):
            near = [g for g in groups if np.min(np.max(np.abs(centre[g] - centre[k]), axis=1)) < reach]
            groups = [g for g in groups if g not in near] + [[*(j for g in near for j in g), k]]
        return groups

    def _fit(self, f_L: Array, usable: Mask, centre: Array, width: Array, force: Array, group: list[int]) -> None:
        layout, params = self.layout, self.params
        distance = np.max(np.abs(layout.uv[:, None] - centre[group]), axis=2).min(axis=1)
        window = np.flatnonzero(distance < 3.5 * layout.pitch)
        uv, forces, known = layout.uv[window], f_L[window], usable[window]
        share = np.empty((len(group), len(window)))
        c, w, f = centre[group], width[group], force[group]
        prior = np.array([params.usual_width * layout.pitch, params.width_weight, params.least_width * layout.pitch])
        fit_bells(uv, layout.pitch, forces, known, c, w, f, prior, int(params.fit_rounds), share)
        size = np.linalg.norm(f, axis=1)
        carried = share * size[:, None]
        owned = np.where(known & (share > 1e-3), carried / np.maximum(carried.sum(axis=0), 1e-12), 0.0)
        missing = 1.0 - np.sum(np.where(known, share, 0.0), axis=1)
        centre[group], width[group] = c, w
        force[group] = owned @ forces + missing[:, None] * f

    def contacts(self, bells: Bells, before: Sequence[SkinContact] = ()) -> tuple[SkinContact, ...]:
        """Return the bells that are strong enough, the strongest first.

        Parameters
        ----------
        bells : Bells
        before : sequence of SkinContact
            Those of the sample before; a bell near one of them stays a contact down to the release force.
        """
        found = []
        for uv, force in zip(bells.centre, bells.force):
            p_LC, R_LC = self.layout.surface(uv)
            contact = SkinContact(self.layout.link, p_LC, R_LC[:, 2].copy(), force.copy())
            goes_on = any(np.linalg.norm(p_LC - other.p_LC) < self.params.travel for other in before)
            least = self.params.release_force if goes_on else self.params.touch_force
            if contact.normal_force > least:
                found.append(contact)
        return tuple(sorted(found, key=lambda contact: -contact.normal_force))
