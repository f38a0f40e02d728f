"""People beside a robot: what they do to it, what it does to them, their Context."""

import numpy as np
import pytest
from bench import Bench
from pydrake.systems.framework import DiagramBuilder

from saphari_drake.errors import ParameterError
from saphari_drake.simulation.people.compliant_people import CompliantPeople, PeopleParameters
from saphari_drake.simulation.people.performance import PerformanceParameters, performance
from saphari_drake.simulation.people.skeleton import SEGMENTS, PersonSizes
from saphari_drake.simulation.world.cell import add_cell

HAND = [segment.name for segment in SEGMENTS].index("right hand")


@pytest.fixture(scope="module")
def people(lwr4):
    builder = DiagramBuilder()
    cell = add_cell(builder, lwr4)
    tip = lwr4.kinematics(lwr4.home).p_WL[6]
    params = PerformanceParameters(
        way=[[0.0, tip[0] + 0.45, -0.18], [20.0, tip[0] + 0.45, -0.18]], reach_from=0.0, reach_until=9.0,
        reach_to=(tip + [0.09, 0.0, 0.05]).tolist(), reach_speed=3.0,
    )  # fmt: skip
    sizes = PersonSizes(hip_height=0.35)  # a child beside an arm on the floor
    person = performance(params, sizes)
    system = CompliantPeople(lwr4, cell.plant, cell.instance, [person], PeopleParameters(sizes=sizes))
    system.show_in_cell = cell
    return system


def test_a_hand_that_reaches_the_robot_pushes_it_and_gives_way(lwr4, people):
    b = Bench(people, state=np.r_[lwr4.home, np.zeros(7)])
    free = b.read("ends").reshape(-1, 2, 3)[HAND]
    assert np.isfinite(free).all()
    b.run(200)
    forces, touch = b.read("forces"), b.read("touch")
    k = int(np.argmax(forces))
    assert forces[k] > 0.0 and SEGMENTS[k].region in ("hand", "forearm")
    (force,) = b.read("applied_forces")[:1]
    np.testing.assert_allclose(np.linalg.norm(force.F_Bq_W.translational()), forces[k], rtol=1e-6)
    np.testing.assert_allclose(touch[:3], force.F_Bq_W.translational())
    assert touch[7] == k and b.read("gap") < 0.0
    assert forces[k] < 200.0, "the arm gives way: nobody leans on a robot with more"


def test_a_clone_goes_its_own_way(lwr4, people):
    b = Bench(people, state=np.r_[lwr4.home, np.zeros(7)])
    b.run(100)
    other = b.clone()
    before = other.read("ends")
    b.run(30)
    np.testing.assert_array_equal(other.read("ends"), before)
    other.run(30)
    np.testing.assert_allclose(other.read("ends"), b.read("ends"), atol=1e-12)


def test_a_hand_that_goes_for_the_robot_comes_nearer(lwr4, people):
    cell = people.show_in_cell
    far = performance(
        PerformanceParameters(way=[[0.0, 1.3, 0.3], [20.0, 1.3, 0.3]], reach_from=15.0), people._params.sizes
    )
    gaps = []
    for speed in (0.0, 1.6):
        system = CompliantPeople(lwr4, cell.plant, cell.instance, [far], PeopleParameters(pursuit_speed=speed))
        b = Bench(system, state=np.r_[lwr4.home, np.zeros(7)])
        b.run(200)
        hand = b.read("ends").reshape(-1, 2, 3)[HAND, 1]
        gaps.append(np.linalg.norm(hand - lwr4.kinematics(lwr4.home).p_WL[6]))
    assert gaps[1] < gaps[0] - 0.3


def test_numbers_that_cannot_be_used_are_named():
    with pytest.raises(ParameterError, match="arm_stiffness"):
        PeopleParameters(arm_stiffness=0.0)
