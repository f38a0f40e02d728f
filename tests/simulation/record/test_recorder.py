"""Recorder: vector and abstract ports on one time axis, samples kept in the Context."""

import numpy as np
import pytest
from pydrake.common.value import AbstractValue
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder, LeafSystem
from pydrake.systems.primitives import Sine

from saphari_drake.errors import ParameterError
from saphari_drake.messages import ContactPoint
from saphari_drake.simulation.record.recorder import Recorder


class Toucher(LeafSystem):
    def __init__(self):
        super().__init__()
        self.DeclareAbstractOutputPort("contact", lambda: AbstractValue.Make(ContactPoint()), self._calc)

    def _calc(self, context, output):
        t = context.get_time()
        output.set_value(ContactPoint(found=t > 0.5, link=int(10 * t), p_LC=np.array([t, 0.0, -t])))


def build(period=0.1):
    builder = DiagramBuilder()
    sine = builder.AddSystem(Sine(np.array([1.0, 2.0]), np.ones(2), np.zeros(2)))
    toucher = builder.AddSystem(Toucher())
    recorder = Recorder(builder, period)
    recorder.add("sine", sine.get_output_port(0), "m")
    recorder.add("point", toucher.get_output_port(), "m", extract=lambda value: value.p_LC)
    recorder.add("found", toucher.get_output_port(), extract=lambda value: value.found, size=1)
    recorder.add("norm", sine.get_output_port(0), "m", extract=np.linalg.norm)
    return builder, recorder, toucher


def test_all_signals_share_the_times():
    builder, recorder, _ = build()
    diagram = builder.Build()
    simulator = Simulator(diagram)
    simulator.AdvanceTo(1.0)
    simulator.AdvanceTo(2.0)
    diagram.ForcedPublish(simulator.get_context())
    log = recorder.log(diagram, simulator.get_context())
    np.testing.assert_allclose(log.time, np.arange(21) * 0.1, atol=1e-12)
    np.testing.assert_allclose(log["sine"], np.outer(np.sin(log.time), [1.0, 2.0]), atol=1e-12)
    np.testing.assert_allclose(log["point"][:, 2], -log.time)
    np.testing.assert_array_equal(log["found"][:, 0], log.time > 0.5)
    np.testing.assert_allclose(log["norm"][:, 0], np.linalg.norm(log["sine"], axis=1))
    assert log.units == {"sine": "m", "point": "m", "found": "", "norm": "m"}


def test_each_context_has_its_own_samples():
    builder, recorder, _ = build()
    diagram = builder.Build()
    simulators = [Simulator(diagram, diagram.CreateDefaultContext()) for _ in range(2)]
    for simulator, end in zip(simulators, (0.35, 0.55)):
        simulator.AdvanceTo(end)
    assert [recorder.log(diagram, s.get_context()).time.size for s in simulators] == [4, 6]


def test_wrong_use_is_named():
    builder, recorder, toucher = build()
    with pytest.raises(ParameterError, match="needs extract"):
        recorder.add("contact", toucher.get_output_port())
    with pytest.raises(ParameterError, match="a signal of this name exists"):
        recorder.add("sine", toucher.get_output_port(), extract=lambda value: value.p_LC)
    with pytest.raises(ParameterError, match="period"):
        Recorder(builder, 0.0)
    with pytest.raises(ParameterError, match="no port was added"):
        Recorder(builder, 0.1).log(None, None)


def test_two_recorders_of_different_periods_may_log_the_same_name():
    builder, recorder, toucher = build()
    fast = Recorder(builder, 0.01)
    for each in (recorder, fast):
        each.add("tip", toucher.get_output_port(), "m", lambda value: value.p_LC, size=3)
    diagram = builder.Build()
    simulator = Simulator(diagram)
    simulator.AdvanceTo(0.355)
    logs = [each.log(diagram, simulator.get_context()) for each in (recorder, fast)]
    assert [len(log.time) for log in logs] == [4, 36]


def test_wrong_size_of_extract_is_named():
    builder, recorder, toucher = build()
    recorder.add("bad", toucher.get_output_port(), extract=lambda value: value.p_LC, size=2)
    simulator = Simulator(builder.Build())
    with pytest.raises(ParameterError, match=r"record bad every 0.1 s: extract gave 3 numbers, 2 are declared"):
        simulator.AdvanceTo(0.1)
