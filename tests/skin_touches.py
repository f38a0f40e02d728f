"""Random touches of a skin by fingers, and how well they are felt."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from saphari_drake.perception.skin.calibration import SkinCalibration, calibrate
from saphari_drake.perception.skin.estimator import SkinLaw
from saphari_drake.simulation.sensors.skin_indenter import IndenterParameters, indent
from saphari_drake.simulation.sensors.skin_modules import SkinLoad, SkinModules

NOISE = 0.001  # V


def calibrated(modules: SkinModules, params: IndenterParameters) -> SkinCalibration:
    """Return the calibration that an indenter's presses on a patch give."""
    return calibrate(modules.layout, indent(modules, params))


class Errors(NamedTuple):
    force: np.ndarray  # of the touch's force, 1 for a touch that is not found
    point: np.ndarray  # m, 0.1 for a touch that is not found
    wrong_count: int  # readings with another number of contacts than touches

    def p95(self):
        return float(np.percentile(self.force, 95)), float(np.percentile(self.point, 95))

    def median(self):
        return float(np.median(self.force)), float(np.median(self.point))


def random_touch(layout, rng, uv):
    """Return a touch of 2–20 N up to 31° off the normal: 5–9 mm in radius, round to oval, flat to pointed."""
    p_L, R_L = layout.surface(uv)
    slope, turn = 0.6 * np.sqrt(rng.random()), rng.uniform(0.0, 2.0 * np.pi)
    direction = R_L @ np.array([slope * np.cos(turn), slope * np.sin(turn), -1.0])
    force = rng.uniform(2.0, 20.0) * direction / np.linalg.norm(direction)
    radius, exponent, shear = rng.uniform([0.005, 0.3, 0.1], [0.009, 2.0, 1.5])
    return SkinLoad(p_L, force, radius, exponent, shear, rng.uniform(1.0, 1.5), rng.uniform(0.0, np.pi))


def random_touches(layout, rng, fingers, margin=1.1, apart=0.018):
    """Return touches whose middles lie `margin` pitches inside the patch, two fingers at least `apart` (m)."""
    extent = layout.extent - margin * layout.pitch
    while True:
        uv = rng.uniform(-extent, extent, (fingers, 2))
        if fingers == 1 or np.linalg.norm(uv[0] - uv[1]) >= apart:
            return [random_touch(layout, rng, each) for each in uv]


def statistics(layout, modules, calibration, touches, fingers, dead=0, drift=0.0, margin=1.1, params=None, seed=0):
    """Return the errors over random touches, each with other dead modules and offsets drifted since the taring.

    The drift (V) is that since the baseline was last taken.
    """
    rng = np.random.default_rng(seed)
    law = SkinLaw(layout, calibration, params)
    start = replace(law.start(), tare_left=0)
    force, point, wrong = [], [], 0
    for k in range(touches):
        pressed = random_touches(layout, rng, fingers, margin)
        moved = drift * (rng.standard_normal((layout.count, 4)) + rng.standard_normal())
        read = modules.voltages(*modules.forces(pressed), moved + NOISE * rng.standard_normal((layout.count, 4)))
        read[rng.choice(layout.count, dead, replace=False)] = 0.0
        found = law.sample(start, read, float(k)).reading.contacts
        wrong += len(found) != fingers
        for touch in pressed:
            near = min(found, key=lambda c: np.linalg.norm(c.p_LC - touch.p_LC), default=None)
            if near is None:
                force.append(1.0)
                point.append(0.1)
            else:
                force.append(np.linalg.norm(near.f_L - touch.f_L) / np.linalg.norm(touch.f_L))
                point.append(np.linalg.norm(near.p_LC - touch.p_LC))
    return Errors(np.array(force), np.array(point), wrong)
