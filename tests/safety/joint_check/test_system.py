"""The check in a diagram: what it passes on, when it believes again, and its Context."""

import numpy as np
import pytest
from bench import PERIOD, Bench
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import BasicVector, DiagramBuilder, LeafSystem
from pydrake.systems.primitives import ConstantVectorSource

from saphari_drake.messages import SystemStatus
from saphari_drake.safety.joint_check.law import JointCheckStatus
from saphari_drake.safety.joint_check.parameters import JointCheckParameters
from saphari_drake.safety.joint_check.system import JointCheck


class TimeFunction(LeafSystem):
    """Puts out a function of time."""

    def __init__(self, function):
        super().__init__()
        self.DeclareVectorOutputPort("y", BasicVector(7), lambda c, out: out.SetFromVector(function(c.get_time())))


@pytest.fixture
def bench(lwr4):
    system = JointCheck(lwr4, JointCheckParameters(period=PERIOD, recovery_time=4 * PERIOD))
    return Bench(system, position_measured=lwr4.home, velocity_measured=np.zeros(7), position_second=lwr4.home)


def moved(q, joint, by):
    q = np.array(q)
    q[joint] += by
    return q


def test_what_is_sound_passes_as_it_is(bench, lwr4):
    for k in range(10):
        q = lwr4.home + 1e-3 * k
        bench.run(1, position_measured=q, position_second=q, velocity_measured=np.full(7, 0.2))
        np.testing.assert_array_equal(bench.read("position_checked"), q)
        np.testing.assert_array_equal(bench.read("velocity_checked"), np.full(7, 0.2))
        assert bench.read("system_status") == SystemStatus.OK and bench.read("joint") == -1


def test_a_doubted_joint_asks_for_the_brakes_until_all_agrees_for_a_while(bench, lwr4):
    bench.run(2, position_measured=moved(lwr4.home, 4, 0.05))
    assert np.isnan(bench.read("position_checked")).all() and np.isnan(bench.read("velocity_checked")).all()
    assert (bench.read("system_status"), bench.read("joint")) == (SystemStatus.BRAKES_ON, 4)
    bench.run(2, position_measured=lwr4.home)
    assert bench.read("status") == JointCheckStatus.RECOVERING and np.isnan(bench.read("position_checked")).all()
    bench.run(5)
    assert bench.read("status") == JointCheckStatus.OK
    np.testing.assert_array_equal(bench.read("position_checked"), lwr4.home)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
@pytest.mark.parametrize("port", ["position_second", "torque_measured", "torque_expected"])
def test_a_witness_that_is_not_known_is_none(bench, lwr4, port, bad):
    bench.run(5, **{port: np.full(7, bad)})
    np.testing.assert_array_equal(bench.read("position_checked"), lwr4.home)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_a_position_that_is_not_known_is_told_and_no_jump(bench, lwr4, bad):
    bench.run(2, position_measured=moved(lwr4.home, 0, bad))
    assert bench.read("system_status") == SystemStatus.BAD_INPUT
    bench.run(2, position_measured=lwr4.home)
    assert bench.read("system_status") == SystemStatus.OK


def test_a_clone_goes_on_as_the_original(bench, lwr4):
    bench.run(2, position_measured=moved(lwr4.home, 4, 0.05))
    other = bench.clone()
    for each in (bench, other):
        each.run(2, position_measured=lwr4.home)
    assert bench.read("status") == other.read("status") == JointCheckStatus.RECOVERING


def test_a_drive_whose_torque_jumps_just_before_the_expected_one_is_sound(lwr4):
    """Both systems are faster than the check: at the end of its period one has gone on, the other one not."""
    jumps = np.random.default_rng(0).uniform(-20.0, 20.0, 200)

    def course(late):
        return TimeFunction(lambda time: np.full(7, jumps[int((time + 1e-4 - late) / PERIOD)]))

    builder = DiagramBuilder()
    check = builder.AddSystem(JointCheck(lwr4, JointCheckParameters(period=PERIOD)))
    given = {"position_measured": lwr4.home, "velocity_measured": np.zeros(7)}
    sources = {name: builder.AddSystem(ConstantVectorSource(value)) for name, value in given.items()}
    sources |= {"torque_measured": builder.AddSystem(course(0.0)), "torque_expected": builder.AddSystem(course(2e-4))}
    for name, source in sources.items():
        builder.Connect(source.get_output_port(), check.GetInputPort(name))
    simulator = Simulator(builder.Build())
    context = check.GetMyContextFromRoot(simulator.get_context())
    for k in range(1, 150):
        simulator.AdvanceTo(k * PERIOD + 2e-6)
        assert check.GetOutputPort("status").Eval(context)[0] == JointCheckStatus.OK


def test_the_torques_in_the_middle_of_a_period_let_the_outputs_be(lwr4):
    """Dynamics, observer and controllers stand behind them, and would be evaluated twice a period."""
    builder = DiagramBuilder()
    check = builder.AddSystem(JointCheck(lwr4, JointCheckParameters(period=PERIOD)))
    times = []

    def seen(context, output):
        times.append(context.get_time())
        output.SetFromVector(position.Eval(context))

    behind = LeafSystem()
    position = behind.DeclareVectorInputPort("u", BasicVector(7))
    behind.DeclareVectorOutputPort("y", BasicVector(7), seen, prerequisites_of_calc={position.ticket()})
    builder.AddSystem(behind)
    builder.Connect(check.GetOutputPort("position_checked"), position)
    simulator = Simulator(builder.Build())
    context = simulator.get_context()
    given = {"position_measured": lwr4.home, "velocity_measured": np.zeros(7), "torque_measured": np.ones(7)}
    for name, value in given.items():
        check.GetInputPort(name).FixValue(check.GetMyMutableContextFromRoot(simulator.get_mutable_context()), value)
    for k in range(1, 40):
        simulator.AdvanceTo(0.25 * k * PERIOD + 2e-6)
        behind.GetOutputPort("y").Eval(behind.GetMyContextFromRoot(context))
    assert len(times) == 10
