"""A bench for one system: inputs fixed by hand, one control cycle at a time; and the rows of a benchmark."""

import argparse
import json
from pathlib import Path

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


def benchmark_options(text, *flags):
    """Return what the command line of a benchmark says: `json`, a file to write its rows to, and its own flags."""
    parser = argparse.ArgumentParser(description=text, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the rows to FILE")
    for flag in flags:
        parser.add_argument(flag, action="store_true")
    return parser.parse_args()


class Timings:
    """The rows of a benchmark, each with its quantiles and its ratio to a peer of the same run."""

    def __init__(self):
        self.rows = {}

    def add(self, name, seconds, aimed_ms=None, aimed_p95_ms=None, peer=None, note=""):
        """Add a row.

        Parameters
        ----------
        name : str
        seconds : array, (k,)
            Wall time of each step.
        aimed_ms, aimed_p95_ms : float, optional
            What median and 95th percentile are aimed at.
        peer : str, optional
            Row of what does the same job.
        note : str
        """
        if name in self.rows:
            raise ValueError(f"two rows are named '{name}'")
        median, p95, p99 = (1e3 * float(np.percentile(seconds, share)) for share in (50, 95, 99))
        self.rows[name] = {
            "median_ms": median,
            "p95_ms": p95,
            "p99_ms": p99,
            "steps": len(seconds),
            "aimed_ms": aimed_ms,
            "aimed_p95_ms": aimed_p95_ms,
            "peer": peer,
            "note": note,
        }

    def document(self):
        """Return the rows by name; `ratio` is the peer's median over the row's own, None where it was not run."""
        peers = {name: self.rows.get(row["peer"]) for name, row in self.rows.items()}
        return {
            name: {**row, "ratio": None if peers[name] is None else peers[name]["median_ms"] / row["median_ms"]}
            for name, row in self.rows.items()
        }

    def write(self, path):
        """Write the rows to a file, if there is one to write to."""
        if path is not None:
            path.write_text(json.dumps(self.document(), indent=1, ensure_ascii=False) + "\n")
