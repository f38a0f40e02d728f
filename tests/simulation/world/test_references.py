"""Signals that are functions of time."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import LogVectorOutput

from saphari_drake.simulation.world.references import Reference


def test_a_held_signal_is_sampled_at_the_start_of_each_cycle():
    """It changes just after the nominal times of the cycle, to the value of that time; without a period it follows."""
    builder = DiagramBuilder()
    held = builder.AddSystem(Reference({"value": lambda t: [t, -t]}, 0.01))
    free = builder.AddSystem(Reference({"value": lambda t: t}))
    logs = [LogVectorOutput(system.get_output_port(), builder, 0.002) for system in (held, free)]
    simulator = Simulator(builder.Build())
    simulator.AdvanceTo(0.1)
    t = logs[0].FindLog(simulator.get_context()).sample_times()
    # At a nominal time itself the sample of the cycle before still holds.
    expected = 0.01 * np.maximum(np.ceil(t / 0.01 - 1e-6) - 1.0, 0.0)
    np.testing.assert_allclose(logs[0].FindLog(simulator.get_context()).data(), [expected, -expected], atol=1e-12)
    np.testing.assert_allclose(logs[1].FindLog(simulator.get_context()).data()[0], t, atol=1e-15)


def test_abstract_values_and_clones():
    """A value that is no array comes as it is; a cloned Context holds its own."""
    system = Reference({"word": lambda t: f"{t:.2f}", "number": lambda t: np.array([t])}, 0.01)
    simulator = Simulator(system)
    simulator.AdvanceTo(0.015)
    context = simulator.get_context()
    clone = Simulator(system, context.Clone())
    simulator.AdvanceTo(0.035)
    words = [system.GetOutputPort("word").Eval(c) for c in (simulator.get_context(), clone.get_context())]
    assert words == ["0.03", "0.01"]
    assert system.GetOutputPort("number").Eval(clone.get_context()) == pytest.approx(0.01)
