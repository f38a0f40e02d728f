"""From voltages of a skin to contacts: forces of the modules, patches of pressure, a bell fitted to each."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from saphari_drake.errors import ParameterError
from saphari_drake.messages import SkinContact
from saphari_drake.parameters import require_non_negative, require_positive
from saphari_drake.perception.skin.bell import Grid
from saphari_drake.perception.skin.calibration import SkinCalibration
from saphari_drake.perception.skin.fit import Prior, completed_forces, fit_window
from saphari_drake.perception.skin.kernels import felt_forces, fill_unusable, pressure_peaks, remove_crosstalk
from saphari_drake.perception.skin.layout import SkinLayout, neighbour_table

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_WINDOW = 3.5  # pitches; beyond that, a bell carries nothing that can be told from noise


@dataclass
class SkinContactParameters:
    """What counts as a contact; assumed."""

    # N; a module below it carries nothing, > 0. Five deviations of its noise.
    module_threshold: float = 0.12
    # N; forces at which a contact begins and ends, > 0.
    touch_force: float = 0.6
    release_force: float = 0.35
    # Share of the lower of two peaks by which it must rise above the pass between them to be a contact of its own, 0–1.
    prominence: float = 0.3
    # What bells may leave, as a share of the force, before one more is tried; the share of that which this may leave to
    # be kept; and how far (m) it must lie from the others.
    split_error: float = 0.06
    split_gain: float = 0.5
    split_distance: float = 0.012
    # m; a contact this near one of the sample before goes on with it.
    travel: float = 0.01
    # Usual and least width of a bell in pitches; weights of the pulls to the usual one and to a round bell.
    usual_width: float = 0.36
    least_width: float = 0.12
    width_weight: float = 0.05
    round_weight: float = 0.1
    # A module counts in the fit with 1/(floor + its force/the largest)²: bells err by a share of themselves.
    floor: float = 0.2
    # Rounds of the crosstalk's solution, turns of it and the fit for modules that are missing, most rounds of a fit.
    crosstalk_rounds: int = 6
    gap_rounds: int = 3
    fit_rounds: int = 15

    def __post_init__(self) -> None:
        require_positive(
            self, "module_threshold", "touch_force", "release_force", "travel", "usual_width", "least_width",
            "split_error", "split_gain", "split_distance", "floor", "crosstalk_rounds", "gap_rounds", "fit_rounds",
        )  # fmt: skip
        require_non_negative(self, "width_weight", "round_weight", "prominence")
        if self.prominence > 1.0:
            raise ParameterError("prominence", f"must not exceed 1, got {self.prominence}")
        if self.release_force > self.touch_force:
            raise ParameterError("release_force", f"must not exceed touch_force, got {self.release_force}")


class Bells(NamedTuple):
    """Contacts in surface coordinates."""

    shape: Array  # (K, 5), see `bell.bell_share`
    force: Array  # (K, 3), N, link frame


class SkinContactLaw:
    """Turns voltages over the baseline into contacts.

    1. Forces of the modules by the calibration, crosstalk removed, (m, 3) in their own frames.
    2. Patches of pressure: connected modules above a threshold, divided where two peaks rise above the pass between.
    3. A bell (middle, width, aspect, force vector) fitted to each patch, neighbours together: F_i ≈ Σ_k B_ik f_k; one
       more where bells leave much. Crosstalk of modules that are missing is taken from the bells, in turns.
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
        params, pitch = self.params, layout.pitch
        usual, least = np.log(params.usual_width * pitch), np.log(params.least_width * pitch)
        self._prior = Prior(
            usual, least, params.width_weight, params.round_weight, params.floor, int(params.fit_rounds)
        )
        self._grid = Grid(layout.uv[:: layout.columns, 0].copy(), layout.uv[: layout.columns, 1].copy(), pitch)
        self._compile()

    def _compile(self) -> None:
        uv = self.layout.uv
        load = 5.0 * np.exp(-0.5 * np.sum(uv**2, axis=1) / self.layout.pitch**2)
        usable = np.ones(self.layout.count, dtype=bool)
        felt_forces(np.zeros((self.layout.count, 4)), self.calibration.inverse, usable, np.empty((len(uv), 3)))
        f_M = -load[:, None] * np.array([0.0, 0.0, 1.0])
        self._fit(self._in_link(f_M), usable, self._start(f_M))
        fill_unusable(self.neighbours, usable, f_M)
        remove_crosstalk(f_M, self.calibration.coupling, self.neighbours, usable, 1, f_M.copy())

    def solve(self, dv: Array, usable: Mask) -> tuple[Array, Bells]:
        """Return the force on each module (m, 3), N, in its own frame, and the bells that explain them.

        Modules that are not usable get what the bells put on them. Their crosstalk disturbs those around, so that
        forces and bells are solved in turns.

        Parameters
        ----------
        dv : (m, 4) array
            Voltages over the baseline (V).
        usable : (m,) bool array
        """
        c, rounds = self.calibration, int(self.params.crosstalk_rounds)
        felt = np.empty((self.layout.count, 3))
        felt_forces(dv, c.inverse, usable, felt)
        f_M = felt.copy()
        fill_unusable(self.neighbours, usable, f_M)
        remove_crosstalk(felt, c.coupling, self.neighbours, usable, rounds, f_M)
        fill_unusable(self.neighbours, usable, f_M)
        bells = self._start(f_M)
        bells, share = self._fit(self._in_link(f_M), usable, bells)
        gaps = np.flatnonzero(~usable & (share.sum(axis=0) > 1e-3))
        last = int(self.params.gap_rounds) if len(gaps) else 0
        for turn in range(1, last + 1):
            f_M[gaps] = np.einsum("gij,gi->gj", self.layout.R_LM[gaps], share[:, gaps].T @ bells.force)
            remove_crosstalk(felt, c.coupling, self.neighbours, usable, rounds, f_M)
            bells, share = self._fit(self._in_link(f_M), usable, bells, split=turn == last)
        force = completed_forces(self._in_link(f_M), usable, share, bells.force)
        return f_M, Bells(bells.shape, force)

    def _in_link(self, f_M: Array) -> Array:
        return np.matmul(self.layout.R_LM, f_M[:, :, None])[:, :, 0]

    def _start(self, f_M: Array) -> Bells:
        """Return a first guess of each contact: patches of pressure with their sums and centroids."""
        layout, params = self.layout, self.params
        label = np.empty(layout.count, dtype=np.int64)
        pressure = -f_M[:, 2]
        count = pressure_peaks(pressure, self.neighbours, params.module_threshold, params.prominence, label)
        f_L = self._in_link(f_M)
        centre, force = np.empty((count, 2)), np.empty((count, 3))
        for k in range(count):
            own = label == k
            centre[k] = pressure[own] @ layout.uv[own] / pressure[own].sum()
            force[k] = f_L[own].sum(axis=0)
        shape = np.zeros((count, 5))
        shape[:, :2], shape[:, 2:4] = centre, np.log(params.usual_width * layout.pitch)
        return Bells(shape, force)

    def _groups(self, centre: Array) -> list[list[int]]:
        """Return contacts whose bells may overlap, together."""
        if len(centre) < 2:
            return [[0]] if len(centre) else []
        reach = 5.0 * self.layout.pitch
        groups: list[list[int]] = []
        for k in range(len(centre)):
            near = [g for g in groups if np.min(np.max(np.abs(centre[g] - centre[k]), axis=1)) < reach]
            groups = [g for g in groups if g not in near] + [[*(j for g in near for j in g), k]]
        return groups

    def _fit(self, f_L: Array, usable: Mask, start: Bells, split: bool = True) -> tuple[Bells, Array]:
        """Return the bells that fit the forces best, and their shares (K, m) of the modules."""
        shapes, forces, shares = [np.empty((0, 5))], [np.empty((0, 3))], [np.empty((0, self.layout.count))]
        for group in self._groups(start.shape[:, :2]):
            bells, share, error = self._fit_group(f_L, usable, Bells(start.shape[group], start.force[group]))
            if split and error > self.params.split_error:
                bells, share = self._split(f_L, usable, bells, share, error)
            shapes.append(bells.shape)
            forces.append(bells.force)
            shares.append(share)
        return Bells(np.concatenate(shapes), np.concatenate(forces)), np.concatenate(shares)

    def _fit_group(self, f_L: Array, usable: Mask, start: Bells) -> tuple[Bells, Array, float]:
        """Fit bells that overlap; return them, their shares, and what they leave as a share of the force."""
        layout = self.layout
        shape, force = start.shape.copy(), start.force.copy()
        share = np.empty((len(shape), layout.count))
        reach = _WINDOW * layout.pitch
        window = [
            int(np.searchsorted(line, edge))
            for line, c in zip(self._grid[:2], shape.T)
            for edge in (c.min() - reach, c.max() + reach)
        ]
        error = fit_window(f_L, usable, tuple(window), self._grid, shape, force, self._prior, share)
        return Bells(shape, force), share, error

    def _split(self, f_L: Array, usable: Mask, bells: Bells, share: Array, error: float) -> tuple[Bells, Array]:
        """Return the bells with one more where they leave most pressure, if that explains much more."""
        layout, params = self.layout, self.params
        pressed = -bells.force @ layout.n_L.T
        left = np.where(usable, -np.sum(layout.n_L * f_L, axis=1) - np.sum(share * pressed, axis=0), 0.0)
        k = int(np.argmax(left))
        near = np.max(np.abs(layout.uv - layout.uv[k]), axis=1) < 1.5 * layout.pitch
        part = np.maximum(left[near], 0.0)
        if part.sum() < params.touch_force:
            return bells, share
        new = np.zeros(5)
        new[:2] = part @ layout.uv[near] / part.sum()
        new[2:4] = np.log(params.usual_width * layout.pitch)
        force = -part.sum() * layout.R_LM[k, :, 2]
        start = Bells(np.vstack([bells.shape, new]), np.vstack([bells.force, force]))
        more, more_share, more_error = self._fit_group(f_L, usable, start)
        apart = np.linalg.norm(more.shape[:-1, :2] - more.shape[-1, :2], axis=1).min()
        if more_error > params.split_gain * error or apart < params.split_distance:
            return bells, share
        return more, more_share

    def contacts(self, bells: Bells, before: Sequence[SkinContact] = ()) -> tuple[SkinContact, ...]:
        """Return the bells that are strong enough, the strongest first.

        Parameters
        ----------
        bells : Bells
        before : sequence of SkinContact
            Those of the sample before; a bell near one of them stays a contact down to the release force.
        """
        found = []
        for uv, force in zip(bells.shape[:, :2], bells.force):
            p_LC, R_LC = self.layout.surface(uv)
            contact = SkinContact(self.layout.link, p_LC, R_LC[:, 2].copy(), force.copy())
            goes_on = any(np.linalg.norm(p_LC - other.p_LC) < self.params.travel for other in before)
            least = self.params.release_force if goes_on else self.params.touch_force
            if contact.normal_force > least:
                found.append(contact)
        return tuple(sorted(found, key=lambda contact: -contact.normal_force))
