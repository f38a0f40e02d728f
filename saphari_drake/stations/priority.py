"""A process that others do not keep waiting."""

import contextlib
import gc
import os
from collections.abc import Iterator


@contextlib.contextmanager
def undisturbed(priority: int) -> Iterator[bool]:
    """Keep out of a block what could make a cycle late: the garbage collector, and other programs.

    Parameters
    ----------
    priority : int
        Real-time priority to ask for (1–99; 0: none).

    Yields
    ------
    bool
        Whether it was granted.
    """
    enabled, granted = gc.isenabled(), False
    gc.collect()
    gc.freeze()
    gc.disable()
    if priority > 0 and hasattr(os, "sched_setscheduler"):
        with contextlib.suppress(OSError):
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
            granted = True
    try:
        yield granted
    finally:
        if granted:
            os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
        gc.unfreeze()
        if enabled:
            gc.enable()
