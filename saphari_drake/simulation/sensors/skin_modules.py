"""What the modules of a sensitive skin are: touches spread over them, and the voltages of their cells."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from saphari_drake.errors import ParameterError
from saphari_drake.parameters import require_choice, require_non_negative, require_positive
from saphari_drake.perception.skin.layout import CELLS, SkinLayout, neighbour_table
from saphari_drake.simulation.sensors.skin_spread import Ellipse, Patch, spread_load

Array = NDArray[np.float64]

_SIGN = np.array([[1.0, 1.0], [1.0, -1.0], [-1.0, 1.0], [-1.0, -1.0]])  # where the cells sit, along u and v


@dataclass
class SkinModuleParameters:
    """The modules as they came from assembly; all values assumed."""

    # Seed of the differences from module to module, ≥ 0.
    seed: int = 0
    # V; reading without load, and its spread.
    offset: float = 0.5
    offset_spread: float = 0.05
    # V/N of a cell for force into the surface; a tangential force counts this share of it, with the cell's sign.
    gain: float = 0.15
    tangential_share: float = 0.5
    # Relative spread of gains, and of each cell's direction.
    gain_spread: float = 0.2
    direction_spread: float = 0.08
    # N; the response is s(1 − exp(−load/s)), with s drawn between these.
    softening: list[float] = field(default_factory=lambda: [30.0, 70.0])
    # Share of a neighbour's load that a cell sees (half of it from a diagonal one), and its relative spread.
    crosstalk: float = 0.04
    crosstalk_spread: float = 0.3
    # Share of the force into the surface that a load at a module's edge adds to a cell: caps tilt.
    tilt: float = 0.02
    # m; thickness over which the cap spreads a load, at most the pitch.
    layer: float = 0.004
    # V; range of the converter, and one step of it (0: exact).
    voltage_range: list[float] = field(default_factory=lambda: [0.0, 3.3])
    resolution: float = 0.0008
    # Modules that do not work, and what they read: "zero", "frozen" (no response, no noise) or "nan".
    dead: list[int] = field(default_factory=list)
    dead_reading: str = "zero"

    def __post_init__(self) -> None:
        require_positive(self, "offset", "gain", "tangential_share", "softening")
        require_non_negative(
            self, "seed", "offset_spread", "gain_spread", "direction_spread", "crosstalk", "crosstalk_spread", "tilt",
            "layer", "voltage_range", "resolution", "dead",
        )  # fmt: skip
        require_choice(self, "dead_reading", ("zero", "frozen", "nan"))
        for name in ("softening", "voltage_range"):
            low, high = getattr(self, name) if len(getattr(self, name)) == 2 else (1.0, 0.0)
            if not low <= high:
                raise ParameterError(name, f"needs two numbers in order, got {getattr(self, name)}")


@dataclass(frozen=True)
class SkinLoad:
    """One contact on the skin.

    Attributes
    ----------
    p_LC : (3,) array
        Its middle, in the link frame (m).
    f_L : (3,) array
        Force on the robot, in the link frame (N).
    radius : float
        Geometric mean of the half axes of the contact ellipse (m).
    exponent, shear_exponent : float
        e of the profile (1 − r²/a²)ᵉ of pressure, and of tangential traction.
    aspect, turn : float
        Ratio of the half axes (≥ 1), and angle of the longer one from u (rad).
    """

    p_LC: Array
    f_L: Array
    radius: float = 0.006
    exponent: float = 0.5
    shear_exponent: float = 0.5
    aspect: float = 1.0
    turn: float = 0.0


class SkinModules:
    """The modules of one patch, each a little different.

    Cell k of module i sees the load δ = w·F + crosstalk and reads V = V₀ + G s (1 − exp(−δ/s)), clipped to the
    converter's range: to second order V₀ + C_i F + quadratic terms. Pressing a module is F_z < 0.

    Parameters
    ----------
    layout : SkinLayout
    params : SkinModuleParameters, optional

    Attributes
    ----------
    offset, gain, softening : (m, 4) arrays
        V₀ (V), G (V/N) and s (N).
    weight : (m, 4, 3) array
        w, how much each component of a module's own force loads each cell.
    dead : (k,) int array
        Modules that do not work.
    """

    def __init__(self, layout: SkinLayout, params: SkinModuleParameters | None = None) -> None:
        self.layout = layout
        self.params = params = params or SkinModuleParameters()
        m = layout.count
        self.dead = np.unique(np.asarray(params.dead, dtype=np.int64))
        if np.any(self.dead >= m):
            raise ParameterError("dead", f"the patch has modules 0 to {m - 1}, got {params.dead}")
        if params.layer > layout.pitch:
            raise ParameterError("layer", f"must not exceed the pitch of {layout.pitch} m, got {params.layer}")
        rng = np.random.default_rng([params.seed, 36])
        self.offset = params.offset + params.offset_spread * rng.uniform(-1.0, 1.0, (m, CELLS))
        self.gain = params.gain * (1.0 + params.gain_spread * rng.uniform(-1.0, 1.0, (m, CELLS)))
        self.softening = rng.uniform(params.softening[0], params.softening[1], (m, CELLS))
        self.weight = np.empty((m, CELLS, 3))
        self.weight[:, :, :2] = params.tangential_share * _SIGN
        self.weight[:, :, 2] = -1.0
        self.weight += params.direction_spread * rng.uniform(-1.0, 1.0, self.weight.shape)
        self._neighbours = neighbour_table(layout.rows, layout.columns)
        share = np.array([1.0] * 4 + [0.5] * 4)[None, :, None] * np.where(self._neighbours < 0, 0.0, 1.0)[:, :, None]
        share = params.crosstalk * share * (1.0 + params.crosstalk_spread * rng.uniform(-1.0, 1.0, (m, 8, CELLS)))
        self._crosstalk = share[..., None] * self.weight[self._neighbours]
        self.forces([SkinLoad(layout.p_LP, -layout.R_LP[:, 2])])  # compiles

    def forces(self, touches: Sequence[SkinLoad]) -> tuple[Array, Array]:
        """Return the force on each module (m, 3), N, in its own frame, and where its pressure acts (m, 2), −1 … 1."""
        layout = self.layout
        total, lean_load, pressure = np.zeros((layout.count, 3)), np.zeros((layout.count, 2)), np.zeros(layout.count)
        share, shear = np.empty(layout.count), np.empty(layout.count)
        lean, unused = np.empty((layout.count, 2)), np.empty((layout.count, 2))
        patch = Patch(layout.rows, layout.columns, layout.pitch, self.params.layer)
        for touch in touches:
            uv, _ = layout.coordinates(touch.p_LC)
            normal = layout.surface(uv)[1][:, 2]
            pressing = float(normal @ touch.f_L)
            sheared = touch.f_L - pressing * normal
            ellipse = Ellipse(uv, touch.radius, touch.aspect, touch.turn)
            spread_load(patch, ellipse, touch.exponent, share, lean)
            spread_load(patch, ellipse, touch.shear_exponent, shear, unused)
            total += share[:, None] * (pressing * normal) + shear[:, None] * sheared
            pressure += abs(pressing) * share
            lean_load += (abs(pressing) * share)[:, None] * lean
        lean_load /= np.maximum(pressure, 1e-12)[:, None]
        return np.einsum("mij,mi->mj", layout.R_LM, total), lean_load

    def voltages(self, f_M: Array, lean: Array, extra: Array | float = 0.0) -> Array:
        """Return what the cells read, (…, m, 4) in V.

        Parameters
        ----------
        f_M : (…, m, 3) array
            Force on each module in its own frame (N).
        lean : (m, 2) array
            Where the pressure of each acts, −1 … 1.
        extra : (…, m, 4) array, optional
            Drift and noise (V), added before the converter.
        """
        params = self.params
        load = np.einsum("mkj,...mj->...mk", self.weight, f_M)
        load -= params.tilt * f_M[..., 2:] * (lean @ _SIGN.T)
        load += np.einsum("mnkj,...mnj->...mk", self._crosstalk, f_M[..., self._neighbours, :])
        exact = self.offset + self.gain * self.softening * (1.0 - np.exp(-load / self.softening)) + extra
        read = exact if params.resolution == 0.0 else params.resolution * np.round(exact / params.resolution)
        read = np.clip(read, params.voltage_range[0], params.voltage_range[1])
        dead = {"zero": 0.0, "frozen": self.offset[self.dead], "nan": np.nan}[params.dead_reading]
        read[..., self.dead, :] = dead
        return read
