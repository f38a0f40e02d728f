"""Force recordings: the three forms of file, their defects, and the rate when a file has no times."""

import builtins
import os
from dataclasses import replace

import numpy as np
import pytest

from saphari_drake.errors import ParameterError, SensorError
from saphari_drake.simulation.people.force_recording import count_runs, fitted_period, read_force_recording

TIME = np.arange(200) * 0.01
FORCE = np.column_stack([np.sin(TIME), 5.0 * TIME, np.full(TIME.size, -2.0)])
ROWS = np.column_stack([TIME, FORCE])


def write_csv(path, rows=ROWS, header="time,fx,fy,fz", sep=","):
    lines = [sep.join("" if np.isnan(x) else repr(float(x)) for x in row) for row in rows]
    path.write_text("\n".join(([header] if header else []) + lines) + "\n")
    return path


def motion(period, count=4000, noise=0.0, seed=0):
    t = np.arange(count) * period
    pos = 0.1 * np.column_stack([np.sin(2.0 * t), np.cos(3.0 * t), t / (1.0 + t)])
    vel = 0.1 * np.column_stack([2.0 * np.cos(2.0 * t), -3.0 * np.sin(3.0 * t), 1.0 / (1.0 + t) ** 2])
    rng = np.random.default_rng(seed)
    return pos + noise * rng.standard_normal(pos.shape), vel + 10.0 * noise * rng.standard_normal(vel.shape)


def write_mat(path, runs):
    io = pytest.importorskip("scipy.io")
    fields = list(runs[0])
    array = np.empty((1, len(runs)), dtype=[(name, object) for name in fields])
    for i, run in enumerate(runs):
        for name in fields:
            array[0, i][name] = run[name]
    io.savemat(path, {"symbol_data": array})
    return path


@pytest.mark.parametrize(
    ("header", "sep"), [("time,fx,fy,fz", ","), ("", ","), ("", ";"), ("Time [s]\tFx [N]\tFy (N)\t fz ", "\t")]
)
def test_csv(tmp_path, header, sep):
    recording = read_force_recording(write_csv(tmp_path / "f.csv", header=header, sep=sep))
    np.testing.assert_allclose(recording.time, TIME)
    np.testing.assert_allclose(recording.force, FORCE)
    assert recording.source == "f.csv" and recording.duration == pytest.approx(1.99)
    assert count_runs(tmp_path / "f.csv") == 1


def test_csv_with_more_columns_in_another_order_comments_and_late_start(tmp_path):
    rows = np.column_stack([np.arange(200), FORCE[:, ::-1], TIME + 7.0])
    path = write_csv(tmp_path / "f.csv", rows, "# a comment\nsample,fz,fy,fx,time")
    recording = read_force_recording(path)
    np.testing.assert_allclose(recording.time, TIME, atol=1e-12)
    np.testing.assert_allclose(recording.force, FORCE)


def test_npz_either_way_round(tmp_path):
    for force in (FORCE, FORCE.T):
        np.savez(tmp_path / "f.npz", time=TIME, force=force)
        np.testing.assert_allclose(read_force_recording(tmp_path / "f.npz").force, FORCE)


def test_short_gap_is_interpolated_and_ends_are_cut(tmp_path):
    rows = ROWS.copy()
    rows[[0, 1, 60, 61, 199], 1:] = np.nan
    rows[100, 2] = np.inf
    recording = read_force_recording(write_csv(tmp_path / "f.csv", rows), max_gap=0.05)
    assert recording.time.size == 197 and recording.time[0] == 0.0
    np.testing.assert_allclose(recording.force[:, 1], 5.0 * TIME[2:199], atol=1e-9)
    assert np.all(np.isfinite(recording.force))


def test_long_gap_names_its_row(tmp_path):
    rows = ROWS.copy()
    rows[60:70, 3] = np.nan
    path = write_csv(tmp_path / "f.csv", rows)
    with pytest.raises(SensorError, match=r"f\.csv: no force from line 62 on for 0\.11 s, more than 0\.05 s"):
        read_force_recording(path)
    assert read_force_recording(path, max_gap=0.2).time.size == 200
    rows = ROWS.copy()
    rows[190:, 1:] = np.nan
    with pytest.raises(SensorError, match="no force from line 192 on"):
        read_force_recording(write_csv(tmp_path / "g.csv", rows))
    np.savez(tmp_path / "h.npz", time=TIME, force=np.where(np.arange(200)[:, None] < 20, np.nan, FORCE))
    with pytest.raises(SensorError, match="no force from row 1 on"):
        read_force_recording(tmp_path / "h.npz")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "is empty"),
        ("\n# only this\n", "is empty"),
        ("time,fx,fy,fz\n", "has a header and no rows"),
        ("time,fx,fy\n0,1,2\n", "no column fz; there are: time, fx, fy"),
        ("0,1,2\n0.1,1,2\n", "line 1 has 3 columns, 4 are needed"),
        ("time,fx,fy,fz\n0,1,2,3\n0.1,1,2\n", "line 3 has 3 columns"),
        ("0,1,2,3\n\n0.1,1,oops,3\n", "line 3: 'oops' is not a number"),
        ("0,1,2,3\n0.2,1,2,3\n0.1,1,2,3\n", "line 3: time 0.1 s does not come after 0.2 s"),
        ("0,1,2,3\n0,1,2,3\n", "line 2: time 0 s does not come after 0 s"),
        ("0,1,2,3\n,1,2,3\n", "line 2 has no time"),
        ("0,1,2,3\n", "1 rows with a force, two are needed"),
        ("\x00\x01\x02", "no column time"),
    ],
)
def test_defects_of_a_csv_are_named_in_one_line(tmp_path, text, said):
    (tmp_path / "f.csv").write_text(text)
    with pytest.raises(SensorError) as caught:
        read_force_recording(tmp_path / "f.csv")
    assert said in str(caught.value) and "f.csv" in str(caught.value) and "\n" not in str(caught.value)


def test_defects_of_other_files_are_named(tmp_path):
    np.savez(tmp_path / "a.npz", t=TIME, f=FORCE)
    with pytest.raises(SensorError, match="no array force; there are: t, f"):
        read_force_recording(tmp_path / "a.npz")
    np.savez(tmp_path / "b.npz", time=TIME[:-1], force=FORCE)
    with pytest.raises(SensorError, match="199 times for 200 forces"):
        read_force_recording(tmp_path / "b.npz")
    np.savez(tmp_path / "c.npz", time=TIME, force=FORCE[:, :2])
    with pytest.raises(SensorError, match=r"force has shape \(200, 2\)"):
        read_force_recording(tmp_path / "c.npz")
    (tmp_path / "d.npz").write_text("text")
    with pytest.raises(SensorError, match="not an NPZ file"):
        read_force_recording(tmp_path / "d.npz")
    with pytest.raises(SensorError, match="no such file"):
        read_force_recording(tmp_path / "missing.csv")
    (tmp_path / "f.xls").write_text("")
    with pytest.raises(SensorError, match=r"\.csv, \.npz and \.mat are read"):
        read_force_recording(tmp_path / "f.xls")
    with pytest.raises(SensorError, match="no run 1; it has 1"):
        read_force_recording(write_csv(tmp_path / "f.csv"), index=1)
    with pytest.raises(ParameterError, match="rate"):
        read_force_recording(tmp_path / "f.csv", rate=0.0)


def test_mat_struct_array(tmp_path):
    pos, vel = motion(0.002, noise=1e-6)
    force = np.column_stack([np.arange(4000.0), np.zeros(4000), np.ones(4000)])
    runs = [dict(pos=pos.T, vel=vel.T, F=(scale * force).T) for scale in (1.0, 2.0)]
    path = write_mat(tmp_path / "f.mat", runs)
    assert count_runs(path) == 2
    recording = read_force_recording(path, index=1)
    np.testing.assert_allclose(recording.force, 2.0 * force)
    assert np.diff(recording.time) == pytest.approx(0.002, rel=0.01)
    assert recording.source == "f.mat, run 1, rate 500 Hz fitted to pos and vel"
    assert read_force_recording(path, rate=100.0).duration == pytest.approx(39.99)
    with pytest.raises(SensorError, match="no run 2; it has 2, counted from 0"):
        read_force_recording(path, index=2)


def test_mat_with_times_without_rate_and_with_defects(tmp_path):
    timed = write_mat(tmp_path / "timed.mat", [dict(F=FORCE, time=TIME)])
    np.testing.assert_allclose(read_force_recording(timed).time, TIME)
    bare = write_mat(tmp_path / "bare.mat", [dict(F=FORCE, note="x")])
    with pytest.raises(SensorError, match="give the rate"):
        read_force_recording(bare)
    still = write_mat(tmp_path / "still.mat", [dict(F=FORCE, pos=0.0 * FORCE, vel=0.0 * FORCE)])
    with pytest.raises(SensorError, match="do not tell the rate"):
        read_force_recording(still)
    other = write_mat(tmp_path / "other.mat", [dict(force=FORCE, t=TIME)])
    with pytest.raises(SensorError, match=r"no struct array with a field F; there are: symbol_data \(force, t\)"):
        count_runs(other)
    (tmp_path / "text.mat").write_text("not MATLAB, but long enough to have a header " * 10)
    with pytest.raises(SensorError, match="not a MATLAB file"):
        read_force_recording(tmp_path / "text.mat")


def test_without_scipy_the_extra_is_named(tmp_path, monkeypatch):
    (tmp_path / "f.mat").write_text("")
    real = builtins.__import__

    def no_scipy(name, *args, **kwargs):
        if name.startswith("scipy"):
            raise ImportError(name)
        return real(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", no_scipy)
    with pytest.raises(SensorError, match=r"needs SciPy; install saphari_drake\[matlab\]"):
        count_runs(tmp_path / "f.mat")


def test_fitted_period_stands_noise_and_lost_samples():
    pos, vel = motion(0.001, count=6000, noise=2e-5)
    kept = np.sort(np.random.default_rng(1).choice(6000, 4000, replace=False))
    assert fitted_period(pos[kept], vel[kept]) == pytest.approx(0.0015, rel=0.03)


def test_a_recording_is_interpolated_held_at_its_ends_and_scaled(tmp_path):
    recording = read_force_recording(write_csv(tmp_path / "f.csv", ROWS[:3]))
    np.testing.assert_allclose([recording.at(t)[1] for t in (-0.1, 0.0, 0.005, 0.02, 0.03)], [0, 0, 0.025, 0.1, 0.1])
    scaled, scale = recording.scaled(8.0)
    assert np.linalg.norm(scaled.force, axis=1).max() == pytest.approx(8.0)
    np.testing.assert_allclose(scaled.force, scale * recording.force)
    np.testing.assert_allclose(recording.scaled(8.0, centred=True)[0].force.mean(axis=0), 0.0, atol=1e-12)
    with pytest.raises(SensorError, match="f.csv: holds no force"):
        replace(recording, force=0.0 * recording.force).scaled(8.0)


def guided_runs(path, seed=0):
    """Write six runs as a robot's logger leaves them; return their forces before the defects.

    Sampled at 1 kHz, of which one row in three is lost; position and velocity with noise; the force sensor slower, so
    that about a third of its rows repeat the one before; and rows without a force, which a MATLAB file keeps as NaN.
    """
    rng, runs, forces = np.random.default_rng(seed), [], []
    for count in (5520, 5472, 8646, 9636, 7704, 5524):
        pos, vel = motion(0.001, 3 * count // 2, 2e-5, int(rng.integers(1000)))
        kept = np.sort(rng.permuted(np.arange(3 * count // 2).reshape(-1, 3), axis=1)[:, :2], axis=None)
        force = 3.0 * np.column_stack([np.sin(0.002 * kept), np.cos(0.0013 * kept), np.sin(0.0007 * kept)]) + 0.5
        held = np.maximum.accumulate(np.where(rng.random(count) < 0.3, 0, np.arange(count)))
        forces.append(force[held])
        broken = forces[-1].T.copy()
        broken[:, 1000:1020] = broken[1, 2000:2003] = np.nan
        runs.append(dict(pos=pos[kept].T, vel=vel[kept].T, F=broken))
    write_mat(path, runs)
    return forces


def test_recording_of_a_person(tmp_path):
    """All runs of a file of the form in which co-manipulation is published: one rate, true forces, short gaps closed.

    A file of this form named by SAPHARI_FORCE_RECORDING is read as well.
    """
    forces = guided_runs(tmp_path / "guided.mat")
    runs = all_runs(tmp_path / "guided.mat")
    assert [run.time.size for run in runs] == [len(force) for force in forces]
    for run, force in zip(runs, forces):
        assert run.time[1] == pytest.approx(0.0015, rel=0.01)
        whole = np.ones(len(force), dtype=bool)
        whole[1000:1020] = whole[2000:2003] = False
        np.testing.assert_array_equal(run.force[whole], force[whole])
        np.testing.assert_allclose(run.force, force, atol=0.05)
    with pytest.raises(SensorError, match=r"row 1001 on for 0\.03"):
        read_force_recording(tmp_path / "guided.mat", index=3, max_gap=0.02)
    given = os.environ.get("SAPHARI_FORCE_RECORDING")
    if given:
        all_runs(given)


def all_runs(path):
    """Return all runs of a file, whose rates agree."""
    runs = [read_force_recording(path, index=i) for i in range(count_runs(path))]
    periods = [run.time[1] for run in runs]
    assert len(runs) == 6 and np.ptp(periods) < 0.01 * np.mean(periods)
    assert all(np.all(np.isfinite(run.force)) and np.ptp(run.force) > 1.0 for run in runs)
    return runs
