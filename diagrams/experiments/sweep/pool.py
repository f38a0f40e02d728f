"""Where trials run: processes of this machine, or the workers of a Ray cluster."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from itertools import islice
from pathlib import Path
from queue import LifoQueue
from typing import Any

from experiments.evidence.runs import THREADS
from experiments.sweep.plan import Plan
from experiments.sweep.worker import Row, Task, run_task
from saphari_drake.errors import SaphariError

ROOT = Path(__file__).resolve().parents[3]
RECYCLE = 40  # trials of a worker: leaf systems written in Python are never freed
MODULE = "experiments.sweep.worker"


class Worker:
    """A process that runs trials, replaced after `recycle` of them and when it dies."""

    def __init__(self, plan: Plan, recycle: int) -> None:
        self._plan, self._recycle, self._left = plan, recycle, 0
        self._process: subprocess.Popen[str] | None = None

    def run(self, task: Task) -> Row:
        """Run one trial; a process that dies of it is its result."""
        if self._left == 0:
            self.close()
            self._start()
        self._left -= 1
        line = self._asked(json.dumps(task))
        if line:
            return Row(*json.loads(line))
        self._left = 0
        error = f"the process died, exit status {self._process.wait() if self._process else None}"
        return Row(task.row, {"trial": task.number, **task.values, "met": False, "error": error}, {}, {})

    def _start(self) -> None:
        pipes: dict[str, Any] = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
        # In a session of its own: an interrupt is told by us, not by its traceback.
        self._process = subprocess.Popen(
            [sys.executable, "-m", MODULE], env=environment(), start_new_session=True, **pipes
        )
        self._left = self._recycle
        self._tell(json.dumps(self._plan.document))

    def _tell(self, text: str) -> None:
        if self._process and self._process.stdin:
            self._process.stdin.write(text + "\n")
            self._process.stdin.flush()

    def _asked(self, text: str) -> str:
        """Send a line and return the answer; empty from a process that died."""
        try:
            self._tell(text)
        except BrokenPipeError:
            return ""
        return self._process.stdout.readline() if self._process and self._process.stdout else ""

    def close(self, now: bool = False) -> None:
        """End the process: after its trial, or now."""
        if self._process is not None:
            if now:
                self._process.kill()
            self._process.communicate()
        self._process = None


def environment() -> dict[str, str]:
    """Return the variables of a worker: one thread, and these scripts on its path."""
    path = [str(ROOT / "diagrams"), str(ROOT), os.environ.get("PYTHONPATH", "")]
    return {**os.environ, **dict.fromkeys(THREADS, "1"), "PYTHONPATH": os.pathsep.join(part for part in path if part)}


def run_local(plan: Plan, tasks: Iterable[Task], workers: int, recycle: int = RECYCLE) -> Iterator[Row]:
    """Run trials on this machine and yield each row as it is done."""
    free: LifoQueue[Worker] = LifoQueue()
    every = [Worker(plan, recycle) for _ in range(workers)]
    for worker in every:
        free.put(worker)

    def run(task: Task) -> Row:
        worker = free.get()
        try:
            return worker.run(task)
        finally:
            free.put(worker)

    pool = ThreadPoolExecutor(workers)
    tasks, under_way = iter(tasks), set[Future[Row]]()
    try:
        while True:
            under_way |= {pool.submit(run, task) for task in islice(tasks, workers - len(under_way))}
            if not under_way:
                return
            done, under_way = wait(under_way, return_when=FIRST_COMPLETED)
            yield from (future.result() for future in done)
    finally:
        busy = bool(under_way)  # interrupted
        for worker in every:
            worker.close(now=busy)
        pool.shutdown(cancel_futures=True)


def run_ray(plan: Plan, tasks: Iterable[Task], address: str, workers: int, recycle: int = RECYCLE) -> Iterator[Row]:
    """Run trials on a Ray cluster, "local" for one of this machine, and yield each row as it is done."""
    ray = _ray()
    settings: dict[str, Any] = {"num_cpus": workers} if address == "local" else {"address": address}
    variables = {name: environment()[name] for name in (*THREADS, "PYTHONPATH")}
    ray.init(**settings, runtime_env={"env_vars": variables}, log_to_driver=False, include_dashboard=False)
    try:
        remote = ray.remote(max_calls=recycle, max_retries=0)(run_task)
        tasks, under_way = iter(tasks), dict[Any, Task]()
        while True:
            for task in islice(tasks, workers - len(under_way)):
                under_way[remote.remote(plan, task)] = task
            if not under_way:
                return
            done, _ = ray.wait(list(under_way))
            for reference in done:
                task = under_way.pop(reference)
                try:
                    yield ray.get(reference)
                except ray.exceptions.RayError as error:
                    told = {"met": False, "error": f"the process died: {type(error).__name__}"}
                    yield Row(task.row, {"trial": task.number, **task.values, **told}, {}, {})
    finally:
        ray.shutdown()


def _ray() -> Any:
    try:
        import ray
    except ImportError as error:
        raise SaphariError("--ray needs the extra ray: pip install 'saphari_drake[ray]'") from error
    return ray
