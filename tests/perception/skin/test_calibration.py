"""Modules and their calibration: loads are kept, forces are recovered, files are checked."""

import numpy as np
import pytest
from skin_touches import calibrated, random_touch

from saphari_drake.errors import ParameterError, SensorError, StateError
from saphari_drake.perception.skin.calibration import SkinCalibration, calibrate
from saphari_drake.perception.skin.contacts import SkinContactLaw
from saphari_drake.perception.skin.layout import SkinLayout, SkinLayoutParameters
from saphari_drake.simulation.sensors.skin_indenter import IndenterParameters, indent
from saphari_drake.simulation.sensors.skin_modules import SkinLoad, SkinModuleParameters, SkinModules

PRESSES = IndenterParameters(presses=80)


@pytest.fixture(scope="module")
def layout(lwr4):
    return SkinLayout(lwr4)


@pytest.fixture(scope="module")
def modules(layout):
    return SkinModules(layout)


@pytest.fixture(scope="module")
def calibration(modules):
    return calibrated(modules, PRESSES)


def test_modules_carry_all_of_a_touch_on_the_skin(layout, modules):
    """Σ R_i F_i is the force, the force-weighted centroid its middle within the curvature, shares beside are lost."""
    rng = np.random.default_rng(1)
    for _ in range(20):
        touch = random_touch(layout, rng, rng.uniform(-0.010, 0.010, 2))
        f_M, lean = modules.forces([touch])
        np.testing.assert_allclose(np.einsum("mij,mj->i", layout.R_LM, f_M), touch.f_L, atol=1e-9)
        assert np.abs(lean).max() <= 1.0
    beside = SkinLoad(layout.surface([0.0, 0.024])[0], np.array([0.0, -10.0, 0.0]))
    f_M, _ = modules.forces([beside])
    assert 0.45 < np.linalg.norm(np.einsum("mij,mj->i", layout.R_LM, f_M)) / 10.0 < 0.55


def test_several_touches_add_up(layout, modules):
    rng = np.random.default_rng(2)
    touches = [random_touch(layout, rng, rng.uniform(-0.015, 0.015, 2)) for _ in range(3)]
    together = modules.forces(touches)[0]
    np.testing.assert_allclose(together, sum(modules.forces([touch])[0] for touch in touches), atol=1e-12)


def test_voltages_start_at_the_offset_rise_and_saturate(layout, modules):
    no_load, no_lean = np.zeros((36, 3)), np.zeros((36, 2))
    np.testing.assert_allclose(modules.voltages(no_load, no_lean), modules.offset, atol=modules.params.resolution)
    before = modules.voltages(no_load, no_lean)
    for size in (2.0, 5.0, 10.0):
        read = modules.voltages(no_load - [0.0, 0.0, size], no_lean)
        assert np.all(read > before)
        before = read
    np.testing.assert_array_equal(modules.voltages(no_load - [0.0, 0.0, 300.0], no_lean), 3.3)


def test_calibration_recovers_the_force_of_every_module(modules, calibration):
    """New presses, also with neighbours pressed at once: within 0.15 N and 3 % of forces up to 12 N."""
    law = SkinContactLaw(modules.layout, calibration)
    rng = np.random.default_rng(3)
    for _ in range(10):
        f_M = rng.uniform([-0.4, -0.4, 0.1], [0.4, 0.4, 1.0], (36, 3)) * rng.uniform(0.5, 12.0, (36, 1))
        f_M[:, 2] *= -1.0
        read = modules.voltages(f_M, np.zeros((36, 2)))
        felt, _ = law.solve(read - calibration.offset, np.ones(36, dtype=bool))
        error = np.linalg.norm(felt - f_M, axis=1)
        assert np.all(error < 0.15 + 0.03 * np.linalg.norm(f_M, axis=1))
    assert np.nanmax(calibration.rms) < 0.1
    assert calibration.dead.size == 0


def test_crosstalk_left_in_would_show(modules, calibration):
    """Without the second step a module beside a 10 N press feels some tenths of a newton."""
    law = SkinContactLaw(modules.layout, calibration)
    f_M = np.zeros((36, 3))
    f_M[14, 2] = -10.0
    dv = modules.voltages(f_M, np.zeros((36, 2))) - calibration.offset
    felt, _ = law.solve(dv, np.ones(36, dtype=bool))
    assert np.linalg.norm(felt[15]) < 0.1
    assert np.linalg.norm(calibration.coupling[15, 2] @ f_M[14]) > 0.25


@pytest.mark.parametrize("reading", ["zero", "frozen", "nan"])
def test_dead_modules_are_found_and_named(layout, reading):
    modules = SkinModules(layout, SkinModuleParameters(dead=[20, 3], dead_reading=reading))
    calibration = calibrated(modules, PRESSES)
    assert calibration.dead.tolist() == [3, 20]
    assert "module   20  dead" in calibration.report()
    assert "2 dead" in calibration.report()


def test_a_file_keeps_everything(tmp_path, layout, calibration):
    path = tmp_path / "skin.npz"
    calibration.save(path)
    loaded = SkinCalibration.load(path, layout)
    for name in ("identity", "offset", "inverse", "coupling", "dead", "rms", "worst", "limits", "largest"):
        np.testing.assert_array_equal(getattr(loaded, name), getattr(calibration, name))


def test_broken_files_are_told(tmp_path, lwr4, layout, calibration):
    path = tmp_path / "skin.npz"
    with pytest.raises(SensorError, match="cannot be read"):
        SkinCalibration.load(path, layout)
    path.write_bytes(b"not a calibration")
    with pytest.raises(SensorError, match="cannot be read"):
        SkinCalibration.load(path, layout)
    calibration.save(path)
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(SensorError, match="cannot be read"):
        SkinCalibration.load(path, layout)
    path.write_bytes(whole)
    with pytest.raises(SensorError, match="belongs to a skin of 6 × 6 modules, 8.00 mm apart"):
        SkinCalibration.load(path, SkinLayout(lwr4, SkinLayoutParameters(pitch=0.007)))
    content = dict(np.load(path))
    for name, change, told in (
        ("version", 99, "version 99"),
        ("offset", np.full((36, 4), np.nan), "offset is not finite"),
        ("inverse", np.zeros((36, 3, 13)), "inverse has shape"),
        ("dead", np.array([36]), "dead modules"),
    ):
        np.savez(path, **{**content, name: change})
        with pytest.raises(SensorError, match=told):
            SkinCalibration.load(path, layout)
    del content["coupling"]
    np.savez(path, **content)
    with pytest.raises(SensorError, match="lacks coupling"):
        SkinCalibration.load(path, layout)


def test_indenter_data_are_checked(lwr4, layout, modules):
    data = indent(modules, IndenterParameters(presses=20))
    with pytest.raises(StateError, match="30 are needed"):
        calibrate(layout, data)
    with pytest.raises(StateError, match="rest has shape"):
        calibrate(SkinLayout(lwr4, SkinLayoutParameters(rows=5)), data)


@pytest.mark.parametrize(
    ("change", "field"),
    [
        ({"gain": 0.0}, "gain"),
        ({"dead_reading": "noise"}, "dead_reading"),
        ({"softening": [70.0, 30.0]}, "softening"),
        ({"voltage_range": [0.0]}, "voltage_range"),
    ],
)
def test_bad_module_parameters_are_named(change, field):
    with pytest.raises((ParameterError, KeyError), match=field):
        SkinModuleParameters(**change)


def test_modules_must_fit_the_layout(layout):
    with pytest.raises(ParameterError, match="0 to 35"):
        SkinModules(layout, SkinModuleParameters(dead=[36]))
    with pytest.raises(ParameterError, match="layer"):
        SkinModules(layout, SkinModuleParameters(layer=0.009))
