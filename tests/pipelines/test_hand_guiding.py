"""The pipeline of hand guiding on a simulated arm that is being led, with each measured port gone bad for a while."""

from types import SimpleNamespace

import numpy as np
import pytest
from experiments.guiding import cell as guiding_cell
from guided_arm import HOME
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import BasicVector, DiagramBuilder, LeafSystem

from saphari_drake.control.hand_guiding.touch import GuidingStatus
from saphari_drake.messages import SystemStatus
from saphari_drake.perception.skin.layout import SkinLayout
from saphari_drake.perception.wrench.estimator import WrenchStatus
from saphari_drake.pipelines.envelope import JointState
from saphari_drake.pipelines.hand_guiding import add_hand_guiding_pipeline
from saphari_drake.robots import catalog
from saphari_drake.simulation.people.guiding_hands import Grip, Hand, Pull

FAULT, AGAIN, END = 0.3, 0.65, 0.85  # s
FORCE = [5.0, 0.0, 3.0]  # N, of a hand that lets go just after the fault begins, and leads again
STATE = ("position", "velocity")


class GoneBad(LeafSystem):
    """Passes a signal on, but for a time in the Context's parameters, in which all of it has one value."""

    def __init__(self, size):
        super().__init__()
        self.DeclareNumericParameter(BasicVector([np.inf, np.inf, np.nan]))  # from, until, value
        self.DeclareVectorInputPort("in", BasicVector(size))
        self.DeclareVectorOutputPort("out", BasicVector(size), self.calc)

    def calc(self, context, output):
        start, end, value = context.get_numeric_parameter(0).value()
        bad = start <= context.get_time() < end
        output.SetFromVector(np.full(output.size(), value) if bad else self.get_input_port().Eval(context))


@pytest.fixture(scope="module")
def arm():
    """The guiding cell, a hand leading its tip, with a `GoneBad` before each port of the pipeline."""
    taps = {}

    def tapped(builder, robot, measured, *rest):
        *held, own, witness = measured
        named = dict(zip((*measured._fields[:-2], "own_position", "own_velocity"), (*held, *own)))
        for name, port in named.items():
            taps[name] = builder.AddSystem(GoneBad(port.size()))
            builder.Connect(port, taps[name].get_input_port())
        *held, position, velocity = (tap.get_output_port() for tap in taps.values())
        measured = type(measured)(*held, JointState(position, velocity), witness)
        return add_hand_guiding_pipeline(builder, robot, measured, *rest)

    robot = catalog.lwr4().with_home(HOME)
    params = guiding_cell.GuidingCellParameters()
    layout = SkinLayout(robot, params.skin_layout)
    grips = [Grip(6, np.array([0.0, 0.0, 0.12]), Hand([Pull(0.12, 0.23, 0.05, FORCE), Pull(AGAIN, 0.25, 0.05, FORCE)]))]
    builder = DiagramBuilder()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(guiding_cell, "add_hand_guiding_pipeline", tapped)
        cell = guiding_cell.add_guiding_cell(builder, robot, grips, params, layout)
    return SimpleNamespace(robot=robot, pipeline=cell.pipeline, diagram=builder.Build(), taps=taps)


def run(arm, port, value, end):
    """Return what the arm does at every millisecond while a port is bad from FAULT to `end`."""
    simulator = Simulator(arm.diagram)
    root, pipeline, plant = simulator.get_mutable_context(), arm.pipeline, arm.diagram.GetSubsystemByName("plant")
    arm.taps[port].GetMyMutableContextFromRoot(root).get_mutable_numeric_parameter(0).SetFromVector([FAULT, end, value])

    def read(system, name):
        return np.array(system.GetOutputPort(name).Eval(system.GetMyContextFromRoot(root)))

    rows = []
    for time in np.arange(0.0, END, 0.001):
        simulator.AdvanceTo(time + 1e-5)
        state = plant.GetPositionsAndVelocities(plant.GetMyContextFromRoot(root))
        rows.append([
            time, *read(pipeline.envelope, "torque_applied"), *state, *read(pipeline.controller, "status"),
            *read(pipeline.controller, "system_status"), *read(pipeline.switch, "system_status"),
            *read(pipeline.wrist, "status"), *read(pipeline.envelope, "system_status"),
        ])  # fmt: skip
    rows, n = np.array(rows), arm.robot.n
    names = ("status", "controller", "switch", "wrist", "envelope")
    told = dict(zip(names, rows[:, 1 + 3 * n :].T))
    return SimpleNamespace(time=rows[:, 0], torque=rows[:, 1 : 1 + n], q=rows[:, 1 + n : 1 + 2 * n], **told)


@pytest.mark.parametrize("end", [FAULT + 0.006, np.inf])
@pytest.mark.parametrize("port", ["own_position", "own_velocity"])
def test_a_state_that_the_envelope_does_not_know_is_told(arm, port, end):
    """The torque is that of the switch, within its limits and their rate; the arm is led on."""
    said = run(arm, port, np.nan, end)
    assert np.all(np.abs(said.torque) <= arm.robot.tau_max)
    assert np.abs(np.diff(said.torque, axis=0)).max() <= 2.0 + 1e-9  # twice the rate: read between two periods
    bad = (said.time > FAULT + 0.001) & (said.time < end - 0.001)
    good = (said.time < FAULT - 0.001) | (said.time > end + 0.001)
    assert np.all(said.envelope[bad] == SystemStatus.BAD_INPUT)
    assert np.all(said.envelope[good] == SystemStatus.OK)


@pytest.mark.parametrize("end", [FAULT + 0.006, np.inf])
@pytest.mark.parametrize("value", [np.nan])
@pytest.mark.parametrize("port", ["position", "velocity", "wrench", "voltages", "sample_time"])
def test_a_port_gone_bad_is_told_and_never_reaches_the_joints(arm, port, value, end):
    """Torque is finite and within its limits, the arm stays where it was, and is led again."""
    said = run(arm, port, value, end)
    assert np.all(np.abs(said.torque) <= arm.robot.tau_max)
    before, after = said.time < FAULT, (said.time > FAULT + 0.003) & (said.time < AGAIN)
    bad, known = after & (said.time < end), port not in STATE
    assert said.status[before][-1] == GuidingStatus.GUIDED
    assert np.ptp(said.q[before][-50:], axis=0).max() > 0.003  # it moves
    assert np.all(said.status[bad] == GuidingStatus.SENSOR_LOST)
    assert np.all(said.controller[bad] == SystemStatus.BAD_INPUT)
    assert np.any(said.wrist[bad] == WrenchStatus.BAD_INPUT) == (port in (*STATE, "wrench"))
    assert np.all(said.switch[bad] == (SystemStatus.OK if known else SystemStatus.BRAKES_ON))
    if known or end < END:  # else it is up to the brakes
        assert np.abs(said.q[after] - said.q[before][-1]).max() < 0.08
    if end < END:
        assert said.status[after][-1] == GuidingStatus.HOLD
        assert said.status[-1] == GuidingStatus.GUIDED
        assert said.controller[-1] == said.switch[-1] == SystemStatus.OK
