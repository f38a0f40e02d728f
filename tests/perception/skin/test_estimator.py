"""The skin's estimator: 500 touches against the bounds, two fingers, dead modules, drift, faults and ports."""

from dataclasses import replace

import numpy as np
import pytest
from bench import Bench
from skin_touches import NOISE, calibrated, random_touch, statistics

from saphari_drake.errors import ParameterError, SensorError
from saphari_drake.messages import SkinStatus
from saphari_drake.perception.skin.bell import Grid, bell_share
from saphari_drake.perception.skin.contacts import SkinContactParameters
from saphari_drake.perception.skin.estimator import SkinEstimator, SkinEstimatorParameters, SkinLaw
from saphari_drake.perception.skin.fit import Load, Prior, fit_bells
from saphari_drake.perception.skin.kernels import pressure_peaks
from saphari_drake.perception.skin.layout import SkinLayout, SkinLayoutParameters, neighbour_table
from saphari_drake.simulation.sensors.skin_indenter import IndenterParameters
from saphari_drake.simulation.sensors.skin_modules import SkinLoad, SkinModules

FORCE_BOUND, POINT_BOUND = 0.05, 0.005  # relative, and m
DRIFT = 0.001  # V; the sensor's drift over a touch of 25 s, 0.2 mV/√s, of each cell and of all
PARAMS = SkinEstimatorParameters(period=0.005)


@pytest.fixture(scope="module")
def skin(lwr4):
    """Layout, modules and calibration."""
    layout = SkinLayout(lwr4)
    modules = SkinModules(layout)
    return layout, modules, calibrated(modules, IndenterParameters(presses=80))


@pytest.fixture(scope="module")
def estimator(skin):
    return SkinEstimator(skin[0], skin[2], PARAMS)


def read(modules, touches, seed=0, extra=0.0):
    """Return noisy voltages under touches, (4m,)."""
    noise = NOISE * np.random.default_rng(seed).standard_normal((modules.layout.count, 4))
    return modules.voltages(*modules.forces(touches), extra + noise).ravel()


def push(layout, size=8.0, uv=(0.003, -0.002)):
    p_L, R_L = layout.surface(uv)
    return SkinLoad(p_L, -size * R_L[:, 2])


def bench_at_rest(estimator, modules, samples=60):
    bench = Bench(estimator, voltages=read(modules, []), sample_time=0.0)
    for k in range(1, samples):
        bench.run(1, voltages=read(modules, [], k), sample_time=PARAMS.period * k)
    return bench


@pytest.mark.parametrize("fingers", [1, 2])
def test_500_touches_are_felt_within_the_bounds(skin, fingers):
    """95 % of all touches lie within 5 % of force and 5 mm; nearly all are told apart."""
    errors = statistics(*skin, 500, fingers, drift=DRIFT, seed=fingers)
    force, point = errors.p95()
    assert force <= FORCE_BOUND
    assert point <= POINT_BOUND
    assert errors.wrong_count <= 2


@pytest.mark.parametrize("fingers", [1, 2])
def test_500_touches_with_a_tenth_of_the_modules_dead(skin, fingers):
    """Points hold for 95 %, the force for 85 %: where the middle of a small touch is dead, its shape decides."""
    errors = statistics(*skin, 500, fingers, dead=4, drift=DRIFT, seed=fingers)
    assert errors.p95()[1] <= POINT_BOUND
    assert errors.median()[0] <= 0.3 * FORCE_BOUND
    assert np.percentile(errors.force, 85) <= FORCE_BOUND
    assert errors.wrong_count <= 10


def test_bells_beat_plain_sums_over_the_modules_that_work(skin):
    """With dead modules the sum of what is left is short by what they carry."""
    layout, modules, calibration = skin
    law = SkinLaw(layout, calibration)
    start = replace(law.start(), tare_left=0)
    rng = np.random.default_rng(5)
    bell, plain = [], []
    for k in range(100):
        touch = random_touch(layout, rng, rng.uniform(-0.012, 0.012, 2))
        voltages = read(modules, [touch], k).reshape(-1, 4)
        dead = rng.choice(36, 4, replace=False)
        voltages[dead] = 0.0
        memory = law.sample(start, voltages, 0.0)
        f_M = memory.f_M.copy()
        f_M[dead] = 0.0
        size = np.linalg.norm(touch.f_L)
        plain.append(np.linalg.norm(np.einsum("mij,mj->i", layout.R_LM, f_M) - touch.f_L) / size)
        bell.append(np.linalg.norm(memory.reading.contacts[0].f_L - touch.f_L) / size)
    assert np.mean(bell) < 0.35 * np.mean(plain)


def test_bells_sum_to_one_and_their_slopes_are_right():
    """The shares on a wide grid add up to 1, their centroid is the middle; slopes agree with differences."""
    line = 0.008 * np.arange(-20, 21)
    shape = np.array([0.003, -0.0017, np.log(0.004), np.log(0.005), 0.3])

    def bell(x):
        share, slope = np.empty(41 * 41), np.empty((41 * 41, 5))
        bell_share(Grid(line, line, 0.008), x, share, slope)
        return share, slope

    share, slope = bell(shape)
    assert share.sum() == pytest.approx(1.0, abs=1e-12)
    for k in range(5):
        step = 1e-6 * np.eye(5)[k]
        difference = (bell(shape + step)[0] - bell(shape - step)[0]) / 2e-6
        np.testing.assert_allclose(slope[:, k], difference, atol=1e-6 * np.abs(slope[:, k]).max())


def test_a_fit_finds_the_bell_that_made_the_forces_without_the_module_in_the_middle():
    line = 0.008 * np.arange(7)
    true = np.array([[0.025, 0.022, np.log(0.004), np.log(0.0045), 0.1]])
    force = np.array([[0.5, -1.0, -9.0]])
    share, slope = np.empty(49), np.empty((49, 5))
    bell_share(Grid(line, line, 0.008), true[0], share, slope)
    weight = np.ones(49)
    weight[24] = 0.0
    shape, found = true + [[0.002, -0.002, 0.2, -0.1, 0.0]], 0.7 * force
    prior, load = Prior(np.log(0.004), np.log(0.001), 1e-6, 1e-6, 0.2, 60), Load(share[:, None] * force, weight)
    fit_bells(Grid(line, line, 0.008), load, shape, found, prior, np.empty((1, 49)))
    np.testing.assert_allclose(found, force, rtol=2e-3)
    np.testing.assert_allclose(shape[0, :2], true[0, :2], atol=2e-5)


def test_peaks_are_divided_only_where_the_pass_between_them_is_deep():
    table = neighbour_table(3, 7)
    label = np.empty(21, dtype=np.int64)
    pressure = np.zeros((3, 7))
    pressure[1] = [0.0, 2.0, 5.0, 3.0, 4.0, 1.0, 0.0]
    assert pressure_peaks(pressure.ravel(), table, 0.1, 0.3, label) == 1
    pressure[1, 3] = 2.0
    assert pressure_peaks(pressure.ravel(), table, 0.1, 0.3, label) == 2
    assert label[7 + 2] == 0 and label[7 + 4] == 1
    np.testing.assert_array_equal(label < 0, pressure.ravel() <= 0.1)


def test_a_touch_shows_in_the_reading_of_its_own_sample(skin, estimator):
    """Force, point, normal and their parts; nothing before, nothing after."""
    layout, modules, _ = skin
    bench = bench_at_rest(estimator, modules)
    assert bench.read("skin_reading").contacts == ()
    bench.set(voltages=read(modules, [push(layout)]), sample_time=0.5)
    reading = bench.read("skin_reading")
    (contact,) = reading.contacts
    assert (reading.stamp, reading.status, contact.link) == (0.5, SkinStatus.OK, layout.link)
    assert contact.normal_force == pytest.approx(8.0, rel=0.03)
    assert np.linalg.norm(contact.f_L + contact.normal_force * contact.n_L) < 0.25
    np.testing.assert_allclose(contact.p_LC, layout.surface([0.003, -0.002])[0], atol=0.001)
    f_L = np.einsum("mij,mj->i", layout.R_LM, bench.read("module_forces").reshape(-1, 3))
    np.testing.assert_allclose(f_L, push(layout).f_L, atol=0.4)
    bench.set(voltages=read(modules, []), sample_time=0.6)
    assert bench.read("skin_reading").contacts == ()


def test_touches_have_hysteresis(skin):
    """A touch between release and onset force is no contact, unless it was one."""
    layout, modules, calibration = skin
    law = SkinLaw(layout, calibration)
    start = replace(law.start(), tare_left=0)
    faint = read(modules, [push(layout, 0.48)]).reshape(-1, 4)
    firm = read(modules, [push(layout, 3.0)]).reshape(-1, 4)
    assert law.sample(start, faint, 0.0).reading.contacts == ()
    touched = law.sample(start, firm, 0.0)
    assert len(law.sample(touched, faint, 0.1).reading.contacts) == 1


def test_the_strongest_contact_comes_first(skin):
    layout, modules, calibration = skin
    law = SkinLaw(layout, calibration)
    both = [push(layout, 4.0, (-0.012, -0.01)), push(layout, 9.0, (0.012, 0.01))]
    contacts = law.sample(replace(law.start(), tare_left=0), read(modules, both).reshape(-1, 4), 0.0).reading.contacts
    assert [round(c.normal_force) for c in contacts] == [9, 4]


def test_drift_is_followed_while_nobody_touches_and_kept_while_somebody_does(skin):
    """An offset that creeps by 30 mV, 0.2 N a module, leaves no contact behind; a held touch is not forgotten."""
    layout, modules, calibration = skin
    law = SkinLaw(layout, calibration, SkinEstimatorParameters(drift_time=0.25))
    memory = law.start()
    for k in range(1000):
        creeping = 0.03 * k / 1000
        memory = law.sample(memory, read(modules, [], k, creeping).reshape(-1, 4), 0.002 * k)
    assert memory.reading.contacts == ()
    assert np.linalg.norm(memory.f_M, axis=1).max() < 0.12
    np.testing.assert_allclose(memory.baseline, modules.offset + 0.03, atol=0.008)
    for k in range(200):
        memory = law.sample(memory, read(modules, [push(layout)], k, 0.03).reshape(-1, 4), 4.0 + 0.002 * k)
    assert memory.reading.contacts[0].normal_force == pytest.approx(8.0, rel=0.04)


def test_taring_takes_the_offset_of_what_is_not_touched(skin, estimator):
    """After the first samples, and after `tare`, offsets of 50 mV are gone; a finger that lies on is not tared away."""
    layout, modules, calibration = skin
    bench = bench_at_rest(estimator, modules)
    estimator.tare(bench.context)
    for k in range(60):
        bench.run(1, voltages=read(modules, [], k, 0.03), sample_time=1.0 + 0.005 * k)
    assert np.abs(bench.read("module_forces")).max() < 0.1
    law = SkinLaw(layout, calibration)
    memory = law.start()
    for k in range(60):
        memory = law.sample(memory, read(modules, [push(layout)], k).reshape(-1, 4), 0.002 * k)
    assert memory.tare_left == 0
    assert memory.reading.contacts[0].normal_force == pytest.approx(8.0, rel=0.08)


def test_dead_modules_are_left_out_and_named(skin, estimator):
    layout, modules, _ = skin
    bench = bench_at_rest(estimator, modules)
    voltages = read(modules, [push(layout)])
    for bad in (0.0, np.nan, -np.inf):
        voltages[4 * 22 : 4 * 22 + 4] = bad
        bench.set(voltages=voltages, sample_time=0.5)
        reading = bench.read("skin_reading")
        assert (reading.status, reading.dead) == (SkinStatus.DEGRADED, (22,))
        assert reading.contacts[0].normal_force == pytest.approx(8.0, rel=0.1)


def test_a_module_that_no_longer_changes_is_dead(skin, estimator):
    _, modules, _ = skin
    bench = bench_at_rest(estimator, modules)
    for k in range(105):
        voltages = read(modules, [], k)
        voltages[40:44] = 0.51
        bench.run(1, voltages=voltages, sample_time=0.5 + 0.005 * k)
    assert bench.read("skin_reading").dead == (10,)


def test_saturation_is_flagged(skin, estimator):
    layout, modules, _ = skin
    bench = bench_at_rest(estimator, modules)
    bench.set(voltages=read(modules, [push(layout, 150.0)]), sample_time=0.5)
    reading = bench.read("skin_reading")
    assert reading.status == SkinStatus.SATURATED
    assert np.isfinite(reading.contacts[0].f_L).all()


def test_voltages_that_are_not_numbers_are_a_lost_skin(skin, estimator):
    """No NaN comes out; the skin is back with the next good sample."""
    layout, modules, _ = skin
    bench = bench_at_rest(estimator, modules)
    bench.set(voltages=np.full(144, np.nan), sample_time=0.5)
    reading = bench.read("skin_reading")
    assert (reading.status, reading.contacts, len(reading.dead)) == (SkinStatus.LOST, (), 36)
    assert bench.read("skin_status") == SkinStatus.LOST
    np.testing.assert_array_equal(bench.read("module_forces"), 0.0)
    bench.run(1)
    bench.run(1, voltages=read(modules, [push(layout)]), sample_time=0.6)
    assert bench.read("skin_reading").status == SkinStatus.OK
    assert len(bench.read("skin_reading").contacts) == 1


def test_samples_that_stop_coming_are_a_lost_skin(skin, estimator):
    layout, modules, _ = skin
    bench = bench_at_rest(estimator, modules)
    bench.run(1, voltages=read(modules, [push(layout)]), sample_time=0.3)
    assert len(bench.read("skin_reading").contacts) == 1
    bench.run(14)
    assert bench.read("skin_reading").status == SkinStatus.LOST
    assert bench.read("skin_reading").contacts == ()


def test_a_cloned_context_goes_on_the_same(skin, estimator):
    layout, modules, _ = skin
    bench = bench_at_rest(estimator, modules, 30)
    other = bench.clone()
    for k in range(40):
        for each in (bench, other):
            each.run(1, voltages=read(modules, [push(layout)], k), sample_time=0.2 + 0.005 * k)
    np.testing.assert_array_equal(bench.read("module_forces"), other.read("module_forces"))
    np.testing.assert_array_equal(
        bench.read("skin_reading").contacts[0].f_L, other.read("skin_reading").contacts[0].f_L
    )


def test_a_calibration_of_another_skin_is_refused(lwr4, skin):
    with pytest.raises(SensorError, match="belongs to a skin of 6 × 6"):
        SkinEstimator(SkinLayout(lwr4, SkinLayoutParameters(rows=5)), skin[2])


@pytest.mark.parametrize(
    ("kind", "change", "field"),
    [
        (SkinContactParameters, {"release_force": 1.0}, "release_force"),
        (SkinContactParameters, {"prominence": 1.5}, "prominence"),
        (SkinContactParameters, {"module_threshold": 0.0}, "module_threshold"),
        (SkinEstimatorParameters, {"drift_time": -1.0}, "drift_time"),
        (SkinEstimatorParameters, {"range_margin": 0.5}, "range_margin"),
        (SkinEstimatorParameters, {"least_usable": 1.1}, "least_usable"),
    ],
)
def test_bad_parameters_are_named(kind, change, field):
    with pytest.raises(ParameterError, match=field):
        kind(**change)
