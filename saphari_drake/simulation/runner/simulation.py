"""A diagram that is run: advanced with a clock beside it, and its logs read at the end."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field

from pydrake.geometry import Meshcat
from pydrake.systems.analysis import ResetIntegratorFromFlags, Simulator
from pydrake.systems.framework import Context, Diagram

from saphari_drake.simulation.faults.watch import Answer, answer
from saphari_drake.simulation.record.frames import FrameKeeper
from saphari_drake.simulation.record.log import Log
from saphari_drake.simulation.record.recorder import Recorder, recorded
from saphari_drake.simulation.runner.interrupt import STOP, InterruptedRunError

CHUNK = 0.1  # simulated time between two looks at the clock (s)


@dataclass(frozen=True)
class RunOptions:
    """What a run is given beside its scenario.

    Attributes
    ----------
    meshcat : Meshcat, optional
        Live view to publish to.
    answered : dict
        For each run with faults, what became of them; the runs fill it in.
    frames : FrameKeeper, optional
        Keeps images of the cameras, one every `CHUNK` at most.
    """

    meshcat: Meshcat | None = None
    answered: dict[int, Answer] = field(default_factory=dict)
    frames: FrameKeeper | None = None

    @property
    def realtime_rate(self) -> float:
        """Rate to aim at: 1 with a live view, otherwise 0 (as fast as possible)."""
        return 0.0 if self.meshcat is None else 1.0


class Simulation:
    """One run of a diagram from its default context, with progress on stderr if that is a terminal.

    Parameters
    ----------
    diagram : Diagram
    label : str
        Said with the progress.
    options : RunOptions, optional

    Attributes
    ----------
    wall, cpu : float
        Time that the run has taken so far on the clock, and of the processor, which other programs do not lengthen (s).
    """

    def __init__(self, diagram: Diagram, label: str = "", options: RunOptions | None = None) -> None:
        self._diagram, self._label, self.wall, self.cpu = diagram, label, 0.0, 0.0
        self._simulator, self._options = Simulator(diagram), options or RunOptions()
        self._number = len(self._options.answered)
        self._simulator.set_target_realtime_rate(self._options.realtime_rate)
        if self._simulator.get_context().num_continuous_states() == 0:
            # Drake's default integrator looks at all systems three times a step, though nothing is to be integrated.
            ResetIntegratorFromFlags(self._simulator, "explicit_euler", CHUNK)
        self._simulator.Initialize()
        if self._options.frames is not None:
            self._options.frames.begin()

    def to(self, end: float) -> Context:
        """Advance to a time (s) and return the root context there."""
        cpu, context = time.process_time(), self._simulator.get_context()
        self.wall += advance(self._simulator, end - context.get_time(), self._label, self._look)
        self.cpu += time.process_time() - cpu
        became = answer(self._diagram, context)
        if became is not None:
            self._options.answered[self._number] = became
        return context

    def _look(self, context: Context) -> None:
        if self._options.frames is not None:
            self._options.frames.look(self._diagram, context)

    def log(self, recorder: Recorder) -> Log:
        """Return what a recorder of the diagram holds."""
        return recorder.log(self._diagram, self._simulator.get_context())

    @property
    def real_time_factor(self) -> float:
        """How much faster than real time the run was."""
        return self._simulator.get_context().get_time() / self.wall


def advance(
    simulator: Simulator, duration: float, label: str = "", look: Callable[[Context], None] = lambda context: None
) -> float:
    """Advance a simulator by `duration` (s), showing progress on stderr if that is a terminal.

    `look` is called every `CHUNK`, and does not change the root context that it is given.

    Returns
    -------
    float
        Wall time it took (s).

    Raises
    ------
    InterruptedRunError
        If the process is told to end meanwhile; it holds what was recorded so far.
    """
    start, wall_start, shown = simulator.get_context().get_time(), time.perf_counter(), -math.inf
    terminal = sys.stderr.isatty()
    steps = max(1, math.ceil(duration / CHUNK - 1e-9))
    STOP.advancing = True
    try:
        for step in range(1, steps + 1):
            simulator.AdvanceTo(start + duration * step / steps)
            look(simulator.get_context())
            if STOP.signal:
                context = simulator.get_context()
                raise InterruptedRunError(recorded(simulator.get_system(), context), context.get_time())
            wall, done = time.perf_counter() - wall_start, duration * step / steps
            if terminal and (wall - shown > 0.1 or step == steps):
                shown = wall
                text = f"{label} {done:.1f} s of {duration:g} s, {step / steps:4.0%}, {done / wall:.2f} × real time"
                print(f"\r{text}\x1b[K", end="", file=sys.stderr, flush=True)
    finally:
        STOP.advancing = False
        if terminal and shown >= 0.0:
            print(file=sys.stderr, flush=True)
    return time.perf_counter() - wall_start
