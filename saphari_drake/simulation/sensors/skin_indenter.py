"""An indenter that presses the modules of a skin patch, for their calibration."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from saphari_drake.parameters import require_non_negative, require_positive
from saphari_drake.perception.skin.calibration import IndenterData
from saphari_drake.perception.skin.layout import CELLS, neighbour_table
from saphari_drake.simulation.sensors.skin_modules import SkinLoad, SkinModules

Array = NDArray[np.float64]


@dataclass
class IndenterParameters:
    """How a simulated indenter presses the middle of one module after the other."""

    # Presses a module, ≥ 30, and their seed.
    presses: int = 120
    seed: int = 0
    # N; least and largest force into the surface, > 0.
    least_force: float = 0.3
    largest_force: float = 18.0
    # Largest tangential force as a share of it. Assumed.
    friction: float = 0.8
    # m; radius of the tip, which fits on one module.
    tip_radius: float = 0.0015
    # V; noise of a cell, and readings averaged a press.
    noise: float = 0.001
    averaged: int = 20

    def __post_init__(self) -> None:
        require_positive(self, "presses", "least_force", "largest_force", "tip_radius", "averaged")
        require_non_negative(self, "seed", "friction", "noise")


def indent(modules: SkinModules, params: IndenterParameters | None = None) -> IndenterData:
    """Press every module of a simulated patch with random forces inside a cone."""
    params = params or IndenterParameters()
    layout = modules.layout
    rng = np.random.default_rng([params.seed, 4])
    noise = params.noise / np.sqrt(params.averaged)
    count = int(params.presses)
    forces, voltages = [], np.full((layout.count, count, 9, CELLS), np.nan)
    table = neighbour_table(layout.rows, layout.columns)
    for i in range(layout.count):
        pressing = params.least_force * (params.largest_force / params.least_force) ** rng.random(count)
        across, turn = params.friction * np.sqrt(rng.random(count)), 2.0 * np.pi * rng.random(count)
        f_M = pressing[:, None] * np.stack([across * np.cos(turn), across * np.sin(turn), -np.ones(count)], axis=1)
        # The load of one press spreads as that of any other: unit forces along the axes of the module.
        unit = [modules.forces([SkinLoad(layout.p_LM[i], axis, params.tip_radius)])[0] for axis in layout.R_LM[i].T]
        loads = np.einsum("pa,amj->pmj", f_M, np.array(unit))
        extra = noise * rng.standard_normal((count, layout.count, CELLS))
        read = modules.voltages(loads, np.zeros((layout.count, 2)), extra)
        around = np.concatenate([[i], table[i]])
        voltages[i][:, around >= 0] = read[:, around[around >= 0]]
        forces.append(f_M)
    rest = modules.voltages(
        np.zeros((layout.count, 3)), np.zeros((layout.count, 2)), noise * rng.standard_normal((layout.count, CELLS))
    )
    pressed = np.repeat(np.arange(layout.count), count)
    limits = np.array(modules.params.voltage_range, dtype=float)
    return IndenterData(pressed, np.concatenate(forces), voltages.reshape(-1, 9, CELLS), rest, limits)
