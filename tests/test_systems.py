"""The control cycle and the cached evaluation that ports share."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import BasicVector, DiagramBuilder, LeafSystem

from saphari_drake.systems import CYCLE_OFFSET, cycle, declare_cache, declare_readouts


class Squares(LeafSystem):
    """Publishes the square and the sum of its input from one evaluation."""

    def __init__(self):
        super().__init__()
        self.evaluations = 0
        port = self.DeclareVectorInputPort("x", BasicVector(2))
        entry = declare_cache(self, "squares", np.zeros(2), self._square, {port.ticket()})
        declare_readouts(self, entry, {"square": (2, lambda y: y), "sum": (1, lambda y: [y.sum()])})

    def _square(self, context):
        self.evaluations += 1
        return self.GetInputPort("x").Eval(context) ** 2


def test_ports_share_one_evaluation_until_an_input_changes():
    system = Squares()
    context = system.CreateDefaultContext()
    system.GetInputPort("x").FixValue(context, [1.0, 2.0])
    np.testing.assert_array_equal(system.GetOutputPort("square").Eval(context), [1.0, 4.0])
    assert system.GetOutputPort("sum").Eval(context) == [5.0]
    assert system.evaluations == 1
    system.GetInputPort("x").FixValue(context, [3.0, 0.0])
    assert system.GetOutputPort("sum").Eval(context) == [9.0]
    assert system.evaluations == 2


def test_clones_of_a_context_do_not_share_cached_values():
    system = Squares()
    context = system.CreateDefaultContext()
    system.GetInputPort("x").FixValue(context, [1.0, 2.0])
    system.GetOutputPort("sum").Eval(context)
    clone = context.Clone()
    system.GetInputPort("x").FixValue(clone, [0.0, 1.0])
    assert system.GetOutputPort("sum").Eval(clone) == [1.0]
    assert system.GetOutputPort("sum").Eval(context) == [5.0]


class Steps(LeafSystem):
    """Stands for a discrete plant: counts its steps of 1 ms."""

    def __init__(self):
        super().__init__()
        self.DeclareDiscreteState(1)
        self.DeclarePeriodicDiscreteUpdateEvent(0.001, 0.0, self._step)
        self.DeclareVectorOutputPort("count", BasicVector(1), self._count)

    def _step(self, context, values):
        values.set_value(0, context.get_discrete_state(0).value() + 1)

    def _count(self, context, output):
        output.SetFromVector(context.get_discrete_state(0).value())


class Sampler(LeafSystem):
    """Passes its input on, one cycle late."""

    def __init__(self, times):
        super().__init__()
        self._times = times
        self._input = self.DeclareVectorInputPort("input", BasicVector(1))
        self._held = self.DeclareDiscreteState(1)
        self.DeclareStateOutputPort("held", self._held)
        self.DeclarePeriodicUnrestrictedUpdateEvent(**cycle(0.005), update=self._update)

    def _update(self, context, state):
        value = float(self._input.Eval(context)[0])
        self._times.append((context.get_time(), value))
        state.get_mutable_discrete_state(self._held).SetFromVector([value])


@pytest.fixture
def samples():
    """Samples (time, value) of two samplers in a chain behind a plant, over 0.1 s."""
    first, second = [], []
    builder = DiagramBuilder()
    plant = builder.AddSystem(Steps())
    # Added against the direction of the data, so that the order of events cannot help.
    behind, before = builder.AddSystem(Sampler(second)), builder.AddSystem(Sampler(first))
    builder.Connect(plant.GetOutputPort("count"), before.GetInputPort("input"))
    builder.Connect(before.GetOutputPort("held"), behind.GetInputPort("input"))
    Simulator(builder.Build()).AdvanceTo(0.1 + 2 * CYCLE_OFFSET)
    return np.array(first), np.array(second)


def test_cycle_fires_each_period_after_the_plants_step(samples):
    """Every sample of a 5 ms cycle sees five more steps of a 1 ms plant, whatever rounding does to the times."""
    times, values = samples[0].T
    np.testing.assert_allclose(times, 0.005 * np.arange(1, 21) + CYCLE_OFFSET, atol=1e-12)
    np.testing.assert_array_equal(values, 5 * np.arange(1, 21) + 1)


def test_all_systems_of_a_cycle_see_the_cycle_before(samples):
    """Updates of one instant do not see one another."""
    first, second = samples
    assert second[0, 1] == 0.0
    np.testing.assert_array_equal(second[1:, 1], first[:-1, 1])
