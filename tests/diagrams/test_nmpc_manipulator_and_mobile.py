"""diagrams/nmpc_manipulator.py and diagrams/nmpc_mobile_manipulator.py: runs past obstacles, outputs, judgement."""

import importlib.util
import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from arms import EXAMPLES
from experiments.nmpc import manipulator as nmpc_manipulator
from experiments.nmpc import mobile as nmpc_mobile
from experiments.nmpc.build import NmpcCell
from experiments.nmpc.jobs import clearance, fixed_obstacles, point_positions, pose_of
from experiments.nmpc.run import NmpcRun, counts, stoppable_clearance, stops, timing
from pydrake.common.yaml import yaml_dump_typed, yaml_load_typed

from saphari_drake.control.nmpc.parameters import NmpcStatus
from saphari_drake.messages import ObstaclePoints
from saphari_drake.robots import catalog
from saphari_drake.robots.dynamics import evaluate_dynamics
from saphari_drake.simulation.people.motion_files import JOINTS
from saphari_drake.simulation.record.log import Log
from saphari_drake.simulation.runner.experiment import main
from saphari_drake.simulation.runner.simulation import RunOptions

DIAGRAMS = Path(__file__).parents[2] / "diagrams"
NEAR = 0.05  # m; so close to the least distance, an obstacle has been reached
FILES = ("metrics.json", "log.npz", "figure.png", "replay.html", "scenario.yaml")


def load(name):
    spec = importlib.util.spec_from_file_location(name, DIAGRAMS / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def manipulator():
    return load("nmpc_manipulator")


@pytest.fixture(scope="module")
def mobile():
    return load("nmpc_mobile_manipulator")


# ---- the jobs -------------------------------------------------------------------------------------------------------


def test_straight_way_of_the_arm_collides():
    """At the reference posture the arm is nearer to an obstacle than allowed; the hand, which must be there, is not."""
    job = nmpc_manipulator.manipulator_job(catalog.lwr4(), nmpc_manipulator.ManipulatorParameters())
    goal = job.robot.home.copy()
    goal[0] += np.deg2rad(60.0)
    p_WC = point_positions(job.robot, job.points, evaluate_dynamics(job.robot, goal, np.zeros(7)))
    away = np.linalg.norm(p_WC[:, None] - job.obstacles(0.0).p_WO[None], axis=2)
    d_min = job.points[0].d_min
    assert away.min() < 0.5 * d_min
    assert away[-2:].min() > d_min and away[0].min() > d_min
    start = point_positions(job.robot, job.points, evaluate_dynamics(job.robot, job.robot.home, np.zeros(7)))
    assert clearance(start, job.points, job.obstacles(0.0)) > 0.0
    np.testing.assert_allclose(job.reference(3.0)[1], pose_of(job.robot, job.end_effector, goal)[1], atol=1e-12)


@pytest.mark.parametrize("name", ["panda", "xarm7"])
def test_points_of_another_arm(name, load_arm):
    """Test points follow the chain of any arm from its base to its end effector, each on a link, none twice."""
    robot = load_arm(name)
    job = nmpc_manipulator.manipulator_job(robot, nmpc_manipulator.ManipulatorParameters(d_min=0.1))
    assert 5 <= len(job.points) <= 8
    assert len({point.name for point in job.points}) == len(job.points)
    p_WC = point_positions(robot, job.points, evaluate_dynamics(robot, job.robot.home, np.zeros(robot.n)))
    steps = np.linalg.norm(np.diff(p_WC, axis=0), axis=1)
    assert steps.min() > 0.04 and steps.max() < 0.6
    assert np.all(job.robot.home >= robot.q_min) and np.all(job.robot.home <= robot.q_max)


def test_mobile_job_starts_at_its_reference():
    """The end effector starts on the path, but for its height, and the platform looks along it."""
    job = nmpc_mobile.mobile_job(catalog.omnirob(), nmpc_mobile.MobileParameters(), "3")
    R, p = pose_of(job.robot, job.end_effector, job.robot.home)
    R_goal, p_goal = job.reference(0.0)
    np.testing.assert_allclose(p[:2], p_goal[:2], atol=1e-12)
    np.testing.assert_allclose(R, R_goal, atol=1e-12)
    assert job.robot.home[2] == pytest.approx(np.pi / 2)
    np.testing.assert_allclose(job.reference(100.0)[1], [0.0, 6.0, 1.2])


def test_path_that_moves_sideways_is_smooth_and_turns_with_its_tangent():
    """The reference of the platform that cannot slip points along its own path."""
    job = nmpc_mobile.mobile_job(catalog.omnirob(), nmpc_mobile.MobileParameters(), "nonholonomic")
    R_start = job.reference(0.0)[0]
    for time in (8.0, 12.0, 17.0):
        way = job.reference(time + 1e-5)[1] - job.reference(time - 1e-5)[1]
        turned = job.reference(time)[0] @ R_start.T
        np.testing.assert_allclose(turned @ [0.0, 1.0, 0.0], way / np.linalg.norm(way), atol=1e-6)


# ---- judgement ------------------------------------------------------------------------------------------------------


def made_up_run(robot, positions, obstacles, commanded=None, status=None):
    """A run from given positions, 1 ms apart."""
    job = nmpc_mobile.mobile_job(robot, nmpc_mobile.MobileParameters(), "3")
    job = replace(job, obstacles=obstacles)
    log = Log(1e-3 * np.arange(len(positions)))
    log.add("position", positions)
    log.add("velocity_commanded", np.zeros_like(positions) if commanded is None else commanded)
    gaps = [
        clearance(
            point_positions(robot, job.points, evaluate_dynamics(robot, q, np.zeros(robot.n))), job.points, obstacles(t)
        )
        for t, q in zip(log.time, positions)
    ]
    log.add("clearance", gaps)
    steps = Log(0.1 * np.arange(len(status) if status else 1))
    steps.add("status", status or [0.0])
    steps.add("step_time", 0.001 * np.ones(len(steps.time)))
    cell = NmpcCell(job, None, None, None, None, None, None)
    return NmpcRun(cell, log, steps, 1.0)


def test_person_who_walks_into_a_robot_at_rest_is_not_held_against_it():
    """Where the robot stood long before, stopping would not have helped; where it moved in, it would have."""
    robot = catalog.omnirob()
    q = np.tile(nmpc_mobile.mobile_start(robot), (600, 1))

    def approaching(time):
        return ObstaclePoints(np.array([[1.0 - 2.0 * time, -0.5, 1.0]]), np.zeros((1, 3)), np.zeros(1), time)

    run = made_up_run(robot, q, approaching)
    assert run.log["clearance"].min() < -0.05
    assert stoppable_clearance(run, 0.1) >= 0.0
    moving = q.copy()
    moving[:, 1] += 0.002 * np.arange(600)
    still = fixed_obstacles(np.array([[0.0, q[0, 1] + 1.8, 1.2]]))
    assert stoppable_clearance(made_up_run(robot, moving, still), 0.1) < 0.0


def test_stops_and_fallbacks_are_counted():
    """A stop is motion that ends before the run's last motion; a fallback is a step that brakes."""
    robot = catalog.omnirob()
    q = np.tile(nmpc_mobile.mobile_start(robot), (100, 1))
    commanded = np.zeros_like(q)
    commanded[10:30, 0] = commanded[50:60, 1] = commanded[70:, 2] = 0.1
    status = [NmpcStatus.SOLVED, NmpcStatus.SOLVED, NmpcStatus.BRAKING, NmpcStatus.START_INSIDE, NmpcStatus.SLACK]
    run = made_up_run(robot, q, fixed_obstacles(np.array([[9.0, 9.0, 9.0]])), commanded, [float(s) for s in status])
    values = {metric.name: metric.value for metric in counts(run)}
    assert values == {"steps": 4, "fallbacks": 2, "slack_steps": 1, "stops": 2} and stops(run) == 2
    assert all(metric.value == pytest.approx(1.0) for metric in timing(run, ""))


@pytest.mark.parametrize(
    ("jobs", "case", "cost", "rows", "slipless", "retreat"),
    [
        (nmpc_manipulator, "none", False, False, False, None),
        (nmpc_manipulator, "objective", True, False, False, None),
        (nmpc_manipulator, "constraints", False, True, False, None),
        (nmpc_manipulator, "both", True, True, False, None),
        (nmpc_mobile, "1", False, False, False, False),
        (nmpc_mobile, "2", True, False, False, False),
        (nmpc_mobile, "3", True, True, False, False),
        (nmpc_mobile, "nonholonomic", True, True, True, False),
        (nmpc_mobile, "human", True, True, False, True),
        (nmpc_mobile, "human_seen", True, True, False, True),
    ],
)
def test_a_case_is_what_it_says(jobs, case, cost, rows, slipless, retreat):
    """Obstacles in the objective, in the constraints, a platform that cannot slip, and a robot that gives way."""
    params = jobs.controller_for(case, jobs.NmpcParameters())
    assert (params.obstacle_cost, params.obstacle_constraints) == (cost, rows)
    assert params.nonholonomic == (["px", "py", "pz"] if slipless else [])
    assert retreat is None or params.retreat == retreat


# ---- the scripts ----------------------------------------------------------------------------------------------------


def written(folder, case):
    """Return metrics, bounds and log of a case, once all its files are there."""
    for name in FILES:
        assert (folder / case / name).stat().st_size > 0
    document = json.loads((folder / case / "metrics.json").read_text())
    return document["metrics"], document["bounds"], Log.load(folder / case / "log.npz")


def test_manipulator_writes_all_files_and_meets_its_bounds(manipulator, tmp_path, capsys):
    """A run to the pose, along an obstacle: all bounds met, all files there, the distance that of the log's samples."""
    arguments = ["--case", "both", "--duration", "5", "--out", str(tmp_path)]
    assert main(manipulator.EXPERIMENT, arguments) == 0, capsys.readouterr().out
    metrics, bounds, log = written(tmp_path, "both")
    assert metrics["min_distance_m"] == pytest.approx(log["distance"].min())
    assert metrics["min_distance_m"] < bounds["min_distance_m"][0] + NEAR
    np.testing.assert_allclose(np.diff(log.time), 1e-3, atol=1e-9)
    assert metrics["steps"] == 50


def test_a_missed_bound_is_status_1(manipulator, capsys):
    """Half a second is not enough to reach the pose."""
    assert main(manipulator.EXPERIMENT, ["--case", "none", "--duration", "0.6"]) == 1
    assert "FAIL" in capsys.readouterr().out


@pytest.mark.skipif(not EXAMPLES.is_dir(), reason="example-robot-data is not installed")
def test_manipulator_takes_another_arm(manipulator, tmp_path, capsys):
    """The Panda of example-robot-data reaches its pose with the same code and bounds, along an obstacle."""
    model = str(EXAMPLES / "panda_description" / "urdf" / "panda.urdf")
    arguments = ["--case", "both", "--duration", "5", "--model", model, "--set", "job.cell.geometry=false"]
    assert main(manipulator.EXPERIMENT, [*arguments, "--out", str(tmp_path)]) == 0, capsys.readouterr().out
    metrics, bounds, _ = written(tmp_path, "both")
    assert metrics["min_distance_m"] < bounds["min_distance_m"][0] + NEAR


def turned_about_z(angle):
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def later(job, begin):
    """Return a mobile job from a time (s) on, with the platform where the end effector is on its path by then."""
    R, p = job.reference(begin)
    R_start, p_start = job.reference(0.0)
    turn = R @ R_start.T
    start = job.robot.home.copy()
    start[:2] = p[:2] + turn[:2, :2] @ (start[:2] - p_start[:2])
    start[2] += np.arctan2(turn[1, 0], turn[0, 0])
    return replace(job, robot=job.robot.with_home(start), reference=lambda time: job.reference(begin + time))


def run_from(mobile, monkeypatch, case, begin, duration, folder, *assignments):
    """Run a case of the mobile manipulator from a time of its job on; return its status."""
    monkeypatch.setattr(mobile, "mobile_job", lambda *given: later(nmpc_mobile.mobile_job(*given), begin))
    arguments = ["--case", case, "--duration", str(duration), "--out", str(folder)]
    for text in (f"job.person.start={begin}", *assignments):
        arguments += ["--set", text]
    return main(mobile.EXPERIMENT, arguments)


@pytest.mark.parametrize("case", ["3", "human", "human_seen"])
def test_mobile_manipulator_passes_its_obstacles(mobile, monkeypatch, case, tmp_path, capsys):
    """The stretch of the path with the obstacles, or the person, on it: bounds met, though they are reached."""
    status = run_from(mobile, monkeypatch, case, 11.0, 5.0, tmp_path, "job.cell.watch.camera.renderer=raycast")
    assert status == 0, capsys.readouterr().out
    metrics, _, log = written(tmp_path, case)
    assert metrics["min_clearance_m"] < 2 * NEAR
    assert log["tip"][0, 1] < 2.5 and log["tip"][-1, 1] > 3.0


def test_the_same_stretch_collides_if_nothing_is_done(mobile, monkeypatch, tmp_path):
    """Without obstacle terms the robot runs into what case 3 passes; with the bound of case 3 it would fail."""
    assert run_from(mobile, monkeypatch, "1", 11.5, 4.5, tmp_path) == 0
    metrics, *_ = written(tmp_path, "1")
    bound = {metric.name: metric for metric in judged_as(mobile, "3")}["min_clearance_m"].low
    assert metrics["min_clearance_m"] < bound - NEAR


def judged_as(mobile, case):
    """Return the metrics of a short run of a case."""
    scenario = mobile.scenario_for(case)
    scenario.duration = 0.2
    return mobile.run(scenario, RunOptions()).metrics


def test_platform_that_cannot_slip_turns_along_its_path(mobile, monkeypatch, tmp_path, capsys):
    """The stretch where the path moves sideways most: no slip in plant and command, within the script's bound."""
    assert run_from(mobile, monkeypatch, "nonholonomic", 6.5, 6.0, tmp_path) == 0, capsys.readouterr().out
    metrics, bounds, log = written(tmp_path, "nonholonomic")
    for name in ("slip", "slip_commanded"):
        assert np.abs(log[name]).max() == metrics[f"lateral_{name}"] <= bounds[f"lateral_{name}"][1]
    assert np.ptp(log["position"][:, 2]) > 0.1  # rad
    assert np.ptp(log["tip"][:, 0]) > 0.1  # m


def test_person_is_seen_by_the_camera_alone(mobile):
    """The controller knows of the person what the camera shows of it: points near the true ones."""
    scenario = mobile.scenario_for("human_seen")
    scenario.duration = 0.5
    scenario.job.cell.watch.camera.renderer = "raycast"
    outcome = mobile.run(scenario, RunOptions())
    names = {metric.name: metric.value for metric in outcome.metrics}
    assert names["known_error_p95_m"] < 0.15 and names["unknown_share"] < 0.5


def test_person_from_a_file(mobile, tmp_path, capsys):
    """A recording of the user is played; one that is missing is told in one line."""
    path = tmp_path / "person.txt"
    rows = np.tile([0.1, 0.0, 0.7], (60, len(JOINTS))) + 0.01 * np.arange(3 * len(JOINTS))
    np.savetxt(path, rows)
    arguments = ["--case", "human", "--duration", "0.3", "--set", f"job.person.file={path}"]
    assert main(mobile.EXPERIMENT, arguments) == 0, capsys.readouterr().out
    assert main(mobile.EXPERIMENT, ["--case", "human", "--set", "job.person.file=/nowhere/x.txt"]) == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1 and "no such file" in lines[0]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--case", "4"], ["4", "nonholonomic"]),
        (["--case", "3", "--set", "job.path.height=-1"], ["height"]),
        (["--case", "3", "--set", "job.cell.controller.Q_v=[-1]"], ["Q_v"]),
        (["--case", "human", "--set", "job.person.radius=[0.1]"], ["radius"]),
    ],
)
def test_bad_input_is_one_line_and_status_2(mobile, capsys, arguments, words):
    """What cannot be used is named."""
    assert main(mobile.EXPERIMENT, arguments) == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1 and all(word in lines[0] for word in words)


@pytest.mark.parametrize("name", ["nmpc_manipulator", "nmpc_mobile_manipulator"])
def test_scenarios_load_with_drake_s_own_loader(name):
    """Every scenario survives being written and read."""
    script = load(name)
    for case in script.CASES:
        scenario = script.scenario_for(case)
        text = yaml_dump_typed(scenario)
        assert yaml_dump_typed(yaml_load_typed(schema=type(scenario), data=text)) == text
