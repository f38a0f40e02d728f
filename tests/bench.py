"""A bench for one system: inputs fixed by hand, one control cycle at a time."""

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.analysis import InitializeParams, Simulator
from pydrake.systems.framework import PortDataType

PERIOD = 0.005


class Bench:
    """Runs a system by itself; inputs stay as they are until set again."""

    def __init__(self, system, **inputs):
        self.system, self.cycles = system, 0
        self._attach(system.CreateDefaultContext())
        self.set(**inputs)
        self.simulator.Initialize()

    def _attach(self, context):
        self.simulator = Simulator(self.system, context)
        self.context = self.simulator.get_mutable_context()

    def set(self, **inputs):
        """Fix input ports by name."""
        for name, value in inputs.items():
            port = self.system.GetInputPort(name)
            vector = port.get_data_type() == PortDataType.kVectorValued
            port.FixValue(self.context, np.atleast_1d(value) if vector else AbstractValue.Make(value))

    def read(self, name):
        """Return the value of an output port; a number for one of size 1."""
        value = self.system.GetOutputPort(name).Eval(self.context)
        if not isinstance(value, np.ndarray):
            return value
        return float(value[0]) if value.shape == (1,) else np.array(value)

    def run(self, cycles=1, **inputs):
        """Set inputs, then run that many control cycles."""
        self.set(**inputs)
        self.cycles += cycles
        self.simulator.AdvanceTo(self.cycles * PERIOD + 2e-6)

    def clone(self):
        """Return a bench that goes on from a clone of the Context."""
        other = object.__new__(Bench)
        other.system, other.cycles = self.system, self.cycles
        other._attach(self.context.Clone())
        other.simulator.Initialize(InitializeParams(suppress_initialization_events=True))
        return other
