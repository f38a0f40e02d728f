"""Ctrl-C and a termination, held back while a run advances, so that it can keep what was recorded so far."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

from saphari_drake.simulation.record.log import Log


class InterruptedRunError(BaseException):
    """A run was told to end.

    Attributes
    ----------
    log : Log
        What was recorded so far.
    time : float
        How far the run came (s).
    """

    def __init__(self, log: Log, time: float) -> None:
        self.log, self.time = log, time
        super().__init__(f"interrupted after {time:.1f} s")


class StopRequest:
    """The signals of a process that tell it to end.

    Attributes
    ----------
    signal : int
        The last one, 0: none.
    advancing : bool
        Whether a run advances, which looks at `signal` by itself.
    """

    signal = 0
    advancing = False

    @property
    def status(self) -> int:
        """Exit status of a process that a signal has ended, as shells have it."""
        return 128 + (self.signal or signal.SIGINT)

    @contextmanager
    def heard(self) -> Iterator[None]:
        """Hear SIGINT and SIGTERM inside; a second one, or one while no run advances, ends the process at once."""
        if threading.current_thread() is not threading.main_thread():
            yield
            return
        before = {number: signal.signal(number, self._hear) for number in (signal.SIGINT, signal.SIGTERM)}
        self.signal = 0
        try:
            yield
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)

    def _hear(self, number: int, frame: FrameType | None) -> None:
        wait = self.advancing and self.signal == 0
        self.signal = number
        if not wait:
            raise KeyboardInterrupt


STOP = StopRequest()
