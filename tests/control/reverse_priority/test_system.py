"""The controller and its experiments: hard bounds, soft bounds, recovery, velocity limits, many random people."""

import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest
from bench import Bench
from experiments.priority import planar
from experiments.priority import three_level as arm
from priority_recursion import reverse_priority
from pydrake.common.yaml import yaml_dump_typed, yaml_load_typed
from pydrake.math import RigidTransform
from pydrake.systems.analysis import Simulator

from saphari_drake.control.reverse_priority import tasks
from saphari_drake.control.reverse_priority.law import PriorityStatus
from saphari_drake.control.reverse_priority.stack import PriorityStack
from saphari_drake.control.reverse_priority.system import (
    ReversePriorityController,
    ReversePriorityParameters,
    frame_reference,
    position_reference,
    scalar_reference,
)
from saphari_drake.errors import ParameterError
from saphari_drake.robots import catalog
from saphari_drake.simulation.runner.experiment import main

NOWHERE = np.zeros((0, 6))
SCRIPT = Path(__file__).parents[3] / "diagrams" / "reverse_priority_planar.py"


@pytest.fixture(scope="module")
def planar_6r():
    return catalog.planar_6r()


def run_planar(robot, case):
    cell = planar.build_planar(robot, planar.PlanarParameters(), case)
    simulator = Simulator(cell.diagram)
    simulator.AdvanceTo(26.1)
    log = cell.recorder.log(cell.diagram, simulator.get_context())
    planar.add_derived(cell, log)
    return {metric.name: metric for metric in planar.judge_planar(cell, log, case)}


def test_planar_home_is_where_the_deliverable_starts(planar_6r):
    np.testing.assert_allclose(planar.tip_position(planar_6r, planar_6r.home), [5.924, -0.168, 0.0], atol=5e-4)


def test_fig_4_constrained(planar_6r):
    """The hard bound holds at every sample, the soft one gives way by the least that the goal needs."""
    metrics = run_planar(planar_6r, "constrained")
    assert [name for name, metric in metrics.items() if not metric.met] == []
    bounded = {name for name, metric in metrics.items() if np.isfinite(metric.low) or np.isfinite(metric.high)}
    assert bounded >= {"max_y4", "error_goal1_m", "error_goal2_m", "min_y4", "max_joint_speed", "activation_jump_max"}
    assert metrics["min_y4"].value <= -0.99


def test_fig_4_without_the_soft_and_without_any_bound(planar_6r):
    """y₄ = −3.88 without the soft bound, 3.12 without any."""
    soft_off = run_planar(planar_6r, "soft_off")
    assert soft_off["max_y4"].met and soft_off["max_y4"].high == planar.PlanarParameters().upper
    assert abs(soft_off["min_y4"].value + 3.88) < 0.02
    free = run_planar(planar_6r, "unconstrained")
    assert abs(free["max_y4"].value - 3.12) < 0.02
    assert max(free["error_goal1_m"].value, free["error_goal2_m"].value) < 1e-6


def test_the_stack_tends_to_the_recursion(lwr4):
    """Three tasks, no constraints, little damping: the result of (24)–(27)."""
    levels = [
        tasks.position_task(lwr4, "link_7"),
        tasks.ScalarTask(tasks.plane_distance(lwr4, "link_4", [0, 1, 0])),
        tasks.ScalarTask(tasks.joint_coordinate(lwr4, "joint_7")),
    ]
    stack = PriorityStack(lwr4, levels, damping=1e-4)
    q = lwr4.home + 0.1
    references = np.array([position_reference([0.6, 0.02, 0.5]), scalar_reference(0.02), scalar_reference(0.12)])
    v_start = np.full(7, 0.01)
    result = stack.solve(q, v_start, references, NOWHERE, 0.005)
    J, rates = result.J_tasks, 10.0 * result.error
    exact = reverse_priority([J[:3], J[3:4], J[4:]], [rates[:3], rates[3:4], rates[4:]], v_start)
    np.testing.assert_allclose(result.v, exact, atol=1e-4)


def test_a_start_outside_the_limits_recovers_within_the_velocity_limits(lwr4):
    """Every joint 0.2 rad beyond its limit, tasks that pull farther out: all are back inside and stay there."""
    stack = PriorityStack(lwr4, [tasks.joint_limits(lwr4, buffer=0.1), tasks.position_task(lwr4, "link_7")])
    q, v = lwr4.q_max + 0.2, np.zeros(7)
    reference = position_reference([1.0, 1.0, 1.0])[None]
    beyond = []
    for _ in range(600):
        v = stack.solve(q, 0.95 * v, reference, NOWHERE, 0.005).v
        assert np.all(np.abs(v) <= lwr4.v_max * (1 + 1e-9))
        q = q + 0.005 * v
        beyond.append(np.max(q - lwr4.q_max))
    assert np.all(np.diff(beyond) <= 1e-9 + 1e-6)
    assert beyond[-1] < 1e-3
    far = stack.solve(lwr4.q_max + 5.0, np.zeros(7), reference, NOWHERE, 0.005)
    assert np.all(np.abs(far.v) <= lwr4.v_max * (1 + 1e-9))
    assert np.all(far.v < 0.0)


def test_velocity_limits_scale_the_task_and_keep_its_direction(lwr4):
    """A reference far too fast: the end effector goes where it should, slower; no joint is clipped by itself."""
    stack = PriorityStack(lwr4, [tasks.joint_limits(lwr4), tasks.position_task(lwr4, "link_7")])
    position = home_point(lwr4)
    fast = stack.solve(lwr4.home, np.zeros(7), position_reference(position, [0.0, 8.0, 2.0])[None], NOWHERE, 0.005)
    slow = stack.solve(lwr4.home, np.zeros(7), position_reference(position, [0.0, 0.08, 0.02])[None], NOWHERE, 0.005)
    assert fast.status == PriorityStatus.SCALED and 0.0 < fast.scale < 1.0
    assert np.abs(fast.v / lwr4.v_max).max() == pytest.approx(1.0, abs=0.01)
    cosine = fast.v @ slow.v / np.linalg.norm(fast.v) / np.linalg.norm(slow.v)
    assert cosine == pytest.approx(1.0, abs=1e-9)


def home_point(robot):
    return robot.kinematics(robot.home).p_WL[robot.link_index("link_7")]


def test_hard_constraints_hold_for_twenty_random_people(lwr4):
    """Clearance and joint limits at every sample of 1 ms, the velocity limits in every command."""
    params = arm.ThreeLevelParameters()
    met = 0
    for seed in range(20):
        run = arm.run_kinematic(arm.three_level_job(lwr4, params, seed), 4.0)
        assert set(run.status) <= {PriorityStatus.OK, PriorityStatus.SCALED}
        assert run.clearance.min() >= params.clearance + params.margin, seed
        assert np.all(run.q <= lwr4.q_max) and np.all(run.q >= lwr4.q_min)
        assert np.all(np.abs(run.v) <= lwr4.v_max * (1 + 1e-9))
        met += run.clearance.min() < params.clearance + params.margin + params.buffer
    assert met >= 15  # the people really come near


def test_a_person_faster_than_the_arm_is_told_and_commands_stay_within_limits(lwr4):
    """Status 2 while the hard constraints need more than the velocity limits allow."""
    params = arm.ThreeLevelParameters(person_speed=6.0)
    job = arm.three_level_job(lwr4, params, 3)
    job.person._omega *= 6.0 / 0.4
    run = arm.run_kinematic(job, 2.0)
    assert np.any(run.status == PriorityStatus.LIMITED)
    assert np.all(np.isfinite(run.v)) and np.all(np.abs(run.v) <= lwr4.v_max * (1 + 1e-9))


def test_a_hard_bound_and_a_soft_one_differ_by_their_place(lwr4):
    """The same wall above the task stops it; below, it gives way."""
    wall = tasks.Bound(tasks.plane_distance(lwr4, "link_7", [0, 0, 1]), upper=0.52, buffer=0.02)
    task = tasks.position_task(lwr4, "link_7")
    goal = home_point(lwr4) + np.array([0.0, 0.0, 0.1])
    heights = {}
    for name, levels in {"hard": [[wall], task], "soft": [task, [wall]]}.items():
        stack, q, v = PriorityStack(lwr4, levels), lwr4.home.copy(), np.zeros(7)
        for _ in range(400):
            v = stack.solve(q, 0.95 * v, position_reference(goal)[None], NOWHERE, 0.005).v
            q = q + 0.005 * v
        heights[name] = lwr4.kinematics(q).p_WL[lwr4.link_index("link_7")][2]
    assert heights["hard"] <= 0.52
    assert heights["soft"] == pytest.approx(goal[2], abs=1e-3)


def test_the_controller_publishes_what_it_does(lwr4):
    """Without references it holds the home posture; targets reach the constraints; (27) lives in the Context."""
    bound = tasks.Bound(tasks.target_distance(lwr4, "link_7", 0, radius=0.1), lower=0.05, buffer=0.1)
    levels = [[bound, *tasks.joint_limits(lwr4)], tasks.pose_task(lwr4, "link_7")]
    controller = ReversePriorityController(lwr4, levels)
    bench = Bench(controller, position_measured=lwr4.home, targets=np.full(6, 5.0))
    np.testing.assert_allclose(bench.read("velocity_commanded"), 0.0, atol=1e-12)
    assert bench.read("activation").shape == bench.read("constraint_excess").shape == (15,)
    assert bench.read("task_error").shape == (6,)
    assert bench.read("smallest_singular_value") > 0.05
    near = np.array([*(home_point(lwr4) + np.array([0.2, 0.0, 0.0])), -0.2, 0.0, 0.0])
    bench.run(1, targets=near)
    assert bench.read("activation").max() > 0.3
    assert bench.read("status") == 0.0 and bench.read("task_scale") == 1.0
    command = bench.read("velocity_commanded")
    clone = bench.clone()
    bench.run(3, targets=np.full(6, 5.0))
    clone.set(targets=near)
    assert np.abs(command).max() > 1e-3
    assert not np.allclose(clone.read("velocity_commanded"), bench.read("velocity_commanded"))


@pytest.mark.parametrize("port", ["position_measured", "references", "targets"])
@pytest.mark.parametrize("value", [np.nan, np.inf])
@pytest.mark.parametrize("cycles", [1, 3, 20])
def test_an_input_that_is_not_finite_stops_the_arm_and_is_told(lwr4, port, value, cycles):
    """For as long as it lasts, and no longer: what is remembered of the fault is a command of zero."""
    bound = tasks.Bound(tasks.target_distance(lwr4, "link_7", 0, radius=0.1), lower=0.05, buffer=0.1)
    controller = ReversePriorityController(lwr4, [[bound], tasks.pose_task(lwr4, "link_7")])
    good = {
        "position_measured": lwr4.home,
        "targets": np.full(6, 5.0),
        "references": frame_reference(RigidTransform(home_point(lwr4) + [0.0, 0.1, 0.0])),
    }
    bench = Bench(controller, **good)
    asked = bench.read("velocity_commanded")
    assert np.abs(asked).max() > 0.1
    bad = good[port].copy()
    bad[-1] = value
    bench.set(**{port: bad})
    for _ in range(cycles):
        assert bench.read("status") == PriorityStatus.INVALID and bench.read("task_scale") == 0.0
        np.testing.assert_array_equal(bench.read("velocity_commanded"), np.zeros(7))
        np.testing.assert_array_equal(bench.read("activation"), np.zeros(1))
        for name in ("task_error", "smallest_singular_value", "constraint_excess"):
            bench.read(name)  # no exception
        bench.run(1)
    bench.set(**good)
    assert bench.read("status") != PriorityStatus.INVALID
    np.testing.assert_array_equal(bench.read("velocity_commanded"), asked)


def test_references_have_their_layout():
    reference = frame_reference(RigidTransform([1.0, 2.0, 3.0]), np.arange(6.0))
    np.testing.assert_array_equal(reference, [*np.eye(3).ravel(), 1, 2, 3, *range(6)])


@pytest.mark.parametrize("field", ["period", "decay", "damping", "task_damping"])
def test_parameters_are_checked(field):
    with pytest.raises(ParameterError, match=field):
        ReversePriorityParameters(**{field: -1.0})
    with pytest.raises(ParameterError, match="decay"):
        ReversePriorityParameters(decay=1.5)


@pytest.fixture(scope="module")
def script():
    spec = importlib.util.spec_from_file_location("reverse_priority_planar", SCRIPT)
    module = importlib.util.module_from_spec(spec)
    sys.modules["reverse_priority_planar"] = module
    spec.loader.exec_module(module)
    return module


def test_the_three_level_circle_is_smooth(lwr4):
    job = arm.three_level_job(lwr4, arm.ThreeLevelParameters(), 0)
    times = np.linspace(0.0, 5.0, 50001)
    references = arm.circle_reference(job, times)
    slopes = np.gradient(references[:, 9:12], times, axis=0)
    np.testing.assert_allclose(references[1:-1, 15:18], slopes[1:-1], atol=1e-5)
    np.testing.assert_allclose(references[0, 9:12], job.p_home)


def test_three_levels_with_torques(script, tmp_path, capsys):
    """The short run through plant, sensor and servo meets its bounds and writes its files."""
    arguments = ["--case", "three_level", "--duration", "1.0", "--out", str(tmp_path)]
    assert main(script.EXPERIMENT, arguments) == 0
    assert {path.name for path in (tmp_path / "three_level").iterdir()} >= {"metrics.json", "figure.png", "replay.html"}
    assert "min_clearance_m" in capsys.readouterr().out


@pytest.mark.parametrize(
    "arguments, words",
    [
        (["--case", "four_level"], ["four_level", "three_level"]),
        (["--set", "planar.buffer=-1"], ["buffer"]),
        (["--set", "arm.elbow=[1]"], ["elbow"]),
        (["--set", "planar.controller.decay=2"], ["decay"]),
        (["--case", "constrained", "--set", "robot=lwr4"], ["tip"]),
    ],
)
def test_bad_input_is_one_line_and_status_2(script, capsys, arguments, words):
    assert main(script.EXPERIMENT, arguments) == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1
    assert all(word in lines[0] for word in words)


@pytest.mark.parametrize("case", ["constrained", "three_level"])
def test_scenarios_load_with_drake_s_own_loader(script, case):
    text = yaml_dump_typed(script.scenario_for(case))
    assert yaml_dump_typed(yaml_load_typed(schema=script.ReversePriorityScenario, data=text)) == text
