"""Trials of the safe cell: the same seed gives the same people, and the ways differ in what they should."""

import numpy as np
import pytest
from bench import Bench
from experiments.cell import scenario as scenarios
from experiments.cell.build import build_cell
from experiments.cell.scenario import CellScenario, at_start, for_way, job_of, person_of, robot_of, seeded
from experiments.nmpc.jobs import pose_of
from pydrake.systems.framework import DiagramBuilder
from safe_cell import scenario_for
from small_bvh import swinging, write_bvh

from saphari_drake.errors import ParameterError, UnknownNameError
from saphari_drake.simulation.people.compliant_people import CompliantPeople
from saphari_drake.simulation.people.performance import performance
from saphari_drake.simulation.world.cell import add_cell


def test_the_same_seed_gives_the_same_people(tmp_path):
    write_bvh(tmp_path / "a.bvh", swinging(20))
    for recordings in ("", str(tmp_path)):
        one, two, other = (
            person_of(CellScenario(seed=seed, recordings=recordings), trial) for seed, trial in ((3, 1), (3, 1), (3, 2))
        )
        assert one == two != other
    with pytest.raises(ParameterError, match="no .bvh file"):
        person_of(CellScenario(recordings=str(tmp_path / "none")), 0)


def test_every_seed_and_trial_has_noise_of_its_own():
    def seeds(seed, trial):
        own = seeded(CellScenario(seed=seed), trial)
        return own.sampler.noise.seed, own.skin_sensor.seed, own.skin_sensor.modules.seed, own.force_sensor.seed

    assert seeds(3, 1) == seeds(3, 1)
    drawn = [*seeds(3, 1), *seeds(3, 2), *seeds(4, 1)]
    assert len(set(drawn)) == len(drawn)


def test_each_camera_has_noise_of_its_own():
    names = [f"camera_sampler_{k}" for k in range(2)]
    samplers = [build_cell(scenario_for("fixed")).diagram.GetSubsystemByName(name) for name in names]
    first, second = (sampler._params.noise.seed for sampler in samplers)
    assert first != second


def test_the_ways_differ_in_what_stops_them():
    supervised, separation, stop, force = (
        for_way(CellScenario(), way) for way in ("supervised", "separation", "stop_at_contact", "force_limited")
    )
    assert (supervised.signals.limit, supervised.supervisor.answer) == ("both", "comply")
    assert (separation.signals.limit, separation.supervisor.answer) == ("separation", "stop")
    assert stop.supervisor.release_time > separation.supervisor.release_time
    assert force.signals.limit == "force" and force.force_limit.reach > 5.0
    with pytest.raises(UnknownNameError, match="supervised"):
        CellScenario(ways=["blind"])


@pytest.mark.parametrize("case", ["fixed", "mobile"])
def test_a_job_begins_and_ends_where_the_robot_stands(case):
    scenario = CellScenario(case=case, robot="lwr4" if case == "fixed" else "omnirob")
    robot = robot_of(scenario)
    job, start = job_of(robot, scenario), at_start(robot, scenario)
    R, p = pose_of(start, job.end_effector, start.home)
    for time in (0.0, job.length):
        np.testing.assert_allclose(job.pose(time)[1], p, atol=1e-9)
        np.testing.assert_allclose(job.pose(time)[0], R, atol=1e-9)
    assert np.linalg.norm(job.pose(0.5 * job.length)[1] - p) > 0.4


def test_people_stand_beside_the_path_of_both_robots_alike():
    """The made-up person is as far from the middle of the path, and reaches as near to it."""
    away = []
    for case in ("fixed", "mobile"):
        scenario = scenario_for(case)
        middle = job_of(robot_of(scenario), scenario).pose(0.25 * scenario.job_time)[1]
        person = person_of(scenario, 0)
        away.append([np.array(person.way[2][1:]) - middle[:2], np.array(person.reach_to)[:2] - middle[:2]])
        assert person.reach_to[2] - middle[2] == pytest.approx(0.1, abs=0.01)
    np.testing.assert_allclose(away[0], away[1], atol=0.01)


def test_a_recorded_person_does_not_begin_in_the_robot(tmp_path, monkeypatch):
    """Over seeds whose first spot would be inside as well; those that are clear stay where they are drawn."""
    write_bvh(tmp_path / "a.bvh", swinging(20))
    monkeypatch.setattr(scenarios, "BEGIN_APART", 0.3)  # the small person is clear of the robot almost everywhere
    moved = 0
    for seed in range(12):
        scenario = CellScenario(seed=seed, recordings=str(tmp_path))
        robot, person = at_start(robot_of(scenario), scenario), person_of(scenario, 0)
        cell = add_cell(DiagramBuilder(), robot)
        people = CompliantPeople(robot, cell.plant, cell.instance, [performance(person, scenario.people.sizes)])
        bench = Bench(people, state=np.concatenate([robot.home, np.zeros(7)]))
        assert bench.read("gap") > 0.3 - 1e-6
        rng = np.random.default_rng([seed, 5, 0])
        moved += not np.allclose(person.spot, [rng.uniform(0.75, 1.15), rng.uniform(-0.3, 0.3)])
    assert 0 < moved < 12
