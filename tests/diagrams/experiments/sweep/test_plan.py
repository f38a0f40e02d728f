"""What a sweep runs: drawn values, names of parameters, the scenario of a trial."""

import numpy as np
import pytest
from experiments.sweep.plan import Plan, find_experiment, plan_of, put, scenario_of, value_at
from pydrake.common.yaml import yaml_dump_typed

from saphari_drake.errors import ParameterError, UnknownNameError
from saphari_drake.simulation.runner.scenario import merged, to_tree

VARY = {"duration": {"uniform": [1.0, 2.0]}, "planar.goals[1][0]": {"choice": [3.0, 4.0]}}
PLAN = Plan("reverse_priority_planar", "soft_off", 3, ("planar.speed=0.5",), {}, VARY)


def test_values_lie_in_their_ranges_and_are_the_same_again():
    plan = Plan("x", "y", vary={"a": {"log_uniform": [0.1, 10.0]}, "b": {"choice": ["p", "q", "r"]}})
    drawn = [plan.drawn(number) for number in range(300)]
    assert drawn == [plan_of(plan.document).drawn(number) for number in range(300)]
    a = np.array([values["a"] for values in drawn])
    assert a.min() >= 0.1 and a.max() <= 10.0 and abs(np.median(np.log(a))) < 0.4
    assert {values["b"] for values in drawn} == {"p", "q", "r"}


def test_ends_of_a_range_are_its_ends():
    assert [value_at({"uniform": [2, 4]}, x) for x in (0.0, 1.0)] == [2.0, 4.0]
    assert [value_at({"log_uniform": [2, 8]}, x) for x in (0.0, 0.5, 1.0)] == pytest.approx([2.0, 4.0, 8.0])
    assert [value_at({"choice": [5, 6]}, x) for x in (0.0, 1.0)] == [5, 6]


@pytest.mark.parametrize(
    "drawn", [{}, {"normal": [0, 1]}, {"uniform": [2, 1]}, {"uniform": 3}, {"log_uniform": [0, 1]}, {"choice": []}]
)
def test_what_cannot_be_drawn_is_named(drawn):
    with pytest.raises(ParameterError, match="duration"):
        Plan("x", "y", vary={"duration": drawn})


def test_a_trial_takes_its_seed_and_its_values():
    experiment = find_experiment(PLAN.script)
    one, other = (scenario_of(experiment, PLAN, number, PLAN.drawn(number)) for number in (0, 5))
    assert (one.seed, other.seed) == (3, 8)
    assert one.planar.speed == other.planar.speed == 0.5
    assert one.duration != other.duration and other.planar.goals[1][0] in (3.0, 4.0)
    single = scenario_of(experiment, Plan(PLAN.script, "random"), 5, {})
    assert single.trial == 5 and single.seed == experiment.scenario_for("random").seed


def test_names_that_do_not_exist_are_told():
    with pytest.raises(UnknownNameError, match="reverse_priority_planar"):
        find_experiment("no_such_script")
    for name in ("a.c", "b[2]", "a.b.c"):
        with pytest.raises(UnknownNameError, match="parameter"):
            put({"a": {"b": 1.0}, "b": [1.0]}, name, 2.0)


@pytest.mark.parametrize("name", ["reverse_priority_planar", "null_space_ball", "nmpc_manipulator"])
def test_a_scenario_that_was_taken_apart_is_the_same_again(name):
    """Tables without an entry, too."""
    scenario = find_experiment(name).scenario_for("random")
    assert yaml_dump_typed(merged(scenario, to_tree(scenario))) == yaml_dump_typed(scenario)
