"""The brakes of the simulated arm: they stop and hold it while they are asked for, and leave it alone otherwise."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import BasicVector, DiagramBuilder, LeafSystem
from pydrake.systems.primitives import ConstantVectorSource

from saphari_drake.messages import SystemStatus
from saphari_drake.simulation.faults.brakes import add_brakes
from saphari_drake.simulation.world.cell import add_cell


class Asking(LeafSystem):
    """Asks for the brakes from 0.1 s on, until 0.4 s."""

    def __init__(self, value):
        super().__init__()
        self._value = value
        ticket = {self.time_ticket()}
        self.DeclareVectorOutputPort("system_status", BasicVector(1), self._status, prerequisites_of_calc=ticket)

    def _status(self, context, output):
        output.SetAtIndex(0, float(self._value if 0.1 <= context.get_time() < 0.4 else SystemStatus.OK))


def fall(robot, value):
    """Return velocities (T, n) at each ms of an arm without torque that falls for 0.6 s."""
    builder = DiagramBuilder()
    cell = add_cell(builder, robot)
    nothing = builder.AddSystem(ConstantVectorSource(np.zeros(robot.n)))
    builder.Connect(nothing.get_output_port(), cell.torque_input)
    builder.AddNamedSystem("asking", Asking(value))
    add_brakes(builder, cell)
    simulator = Simulator(builder.Build())
    v = []
    for k in range(600):
        simulator.AdvanceTo(0.001 * k + 2e-6)
        v.append(cell.robot_state.Eval(cell.plant.GetMyContextFromRoot(simulator.get_context()))[robot.n :])
    return np.array(v)


@pytest.fixture(scope="module")
def free(lwr4):
    return fall(lwr4, SystemStatus.OK)


def test_brakes_stop_a_falling_arm_and_let_it_go(lwr4, free):
    v = np.abs(fall(lwr4, SystemStatus.BRAKES_ON)).max(axis=1)
    assert np.abs(free[100]).max() > 0.3  # it falls
    assert v[200:400].max() < 1e-3
    assert v[-1] > 0.3


@pytest.mark.parametrize("value", [SystemStatus.BAD_INPUT, SystemStatus.HOLDING])
def test_other_states_ask_for_no_brakes(lwr4, free, value):
    np.testing.assert_array_equal(fall(lwr4, value), free)
