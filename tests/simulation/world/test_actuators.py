"""What the drives make of a torque: late by cycles, with bias, ripple over the position, and noise of its size."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource, LogVectorOutput, MatrixGain, Sine

from saphari_drake.robots.catalog import omnirob
from saphari_drake.simulation.world.actuators import Actuators
from saphari_drake.simulation.world.cell import add_cell
from saphari_drake.simulation.world.profile import PlantProfile, Truth

STEP, START = 0.001, np.arange(7.0)


def driven(robot, truth, q=None, seconds=0.05, wave=True):
    """Return what the drives get and give, (T, n) each, at the plant's steps."""
    builder = DiagramBuilder()
    amplitude = np.full(robot.n, 10.0 if wave else 0.0)
    source = builder.AddSystem(Sine(amplitude, np.linspace(50.0, 90.0, robot.n), np.zeros(robot.n)))
    q = np.zeros(robot.n) if q is None else q
    state = builder.AddSystem(ConstantVectorSource(np.r_[q, np.zeros(robot.n)]))
    drives = builder.AddSystem(Actuators(robot, truth, STEP, np.resize(START, robot.n)))
    builder.Connect(source.get_output_port(0), drives.GetInputPort("torque_applied"))
    builder.Connect(state.get_output_port(), drives.GetInputPort("state"))
    logs = [LogVectorOutput(port, builder, STEP) for port in (source.get_output_port(0), drives.get_output_port())]
    simulator = Simulator(builder.Build())
    simulator.AdvanceTo(seconds)
    return [log.FindLog(simulator.get_context()).data().T for log in logs]


@pytest.mark.parametrize(("cycles", "period"), [(0, 0.005), (1, 0.005), (2, 0.002), (1, 0.001)])
def test_a_torque_is_late_by_cycles(lwr4, cycles, period):
    steps = round(cycles * period / STEP)
    asked, given = driven(lwr4, Truth(PlantProfile(torque_delay=cycles), 0, period))
    assert np.array_equal(given[steps:], asked[: len(asked) - steps])
    assert np.array_equal(given[:steps], np.tile(START, (steps, 1)))


def test_noise_has_its_size_and_no_memory(lwr4):
    asked, given = driven(lwr4, Truth(PlantProfile(torque_noise=0.05), 5), seconds=3.0, wave=False)
    noise = (given - asked)[1:]
    assert noise.std(axis=0) == pytest.approx(0.05, rel=0.1)
    assert abs(np.corrcoef(noise[1:, 0], noise[:-1, 0])[0, 1]) < 0.06
    again = driven(lwr4, Truth(PlantProfile(torque_noise=0.05), 5), seconds=3.0, wave=False)[1]
    other = driven(lwr4, Truth(PlantProfile(torque_noise=0.05), 6), seconds=0.1, wave=False)[1]
    assert np.array_equal(given, again) and not np.array_equal(given[:100], other[:100])


def test_bias_is_constant_and_of_one_size(lwr4):
    asked, given = driven(lwr4, Truth(PlantProfile(torque_bias=0.2), 1))
    assert np.abs(given - asked) == pytest.approx(0.2)


def test_ripple_goes_round_with_the_joint(lwr4):
    truth = Truth(PlantProfile(torque_ripple=0.2, ripple_waves=16.0), 1)
    turns = np.linspace(0.0, 2.0 * np.pi / 16.0, 40)
    given = np.array([driven(lwr4, truth, np.full(7, q), 0.001, wave=False)[1][-1] for q in turns])
    assert given[0] == pytest.approx(given[-1], abs=1e-9)
    assert given.max(axis=0) == pytest.approx(0.2, rel=0.01) and given.min(axis=0) == pytest.approx(-0.2, rel=0.01)


def test_a_platform_gets_noise_by_its_force():
    robot = omnirob()
    asked, given = driven(robot, Truth(PlantProfile(torque_bias=0.2)), wave=False)
    np.testing.assert_allclose(np.abs((given - asked)[-1, :2]), 0.2 * robot.tau_max[:2] / 100.0)


def test_a_controller_sees_the_plant_before_its_step(lwr4):
    """A torque by the state is late by whole steps, not by one less: the plant's step is not seen by what it gets."""
    builder = DiagramBuilder()
    cell = add_cell(builder, lwr4, truth=Truth(PlantProfile(torque_delay=1), 0, 0.002))
    law = builder.AddSystem(MatrixGain(np.hstack([np.zeros((7, 7)), -0.5 * np.eye(7)])))
    builder.Connect(cell.robot_state, law.get_input_port())
    builder.Connect(law.get_output_port(), cell.torque_input)
    asked, given = (LogVectorOutput(port, builder, STEP) for port in (law.get_output_port(), cell.torque_driving))
    simulator = Simulator(builder.Build())
    simulator.AdvanceTo(0.05)
    asked, given = (log.FindLog(simulator.get_context()).data().T for log in (asked, given))
    assert np.array_equal(given[2:], asked[:-2]) and np.ptp(asked, axis=0).max() > 0.1
