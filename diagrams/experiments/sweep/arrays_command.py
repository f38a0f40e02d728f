"""Runs trials on arrays in blocks, on all cores, and counts what they violate."""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from experiments.evidence.progress import minutes
from experiments.sweep.arrays import TRIALS
from experiments.sweep.rows import pyarrow_parquet
from experiments.trials import interval
from saphari_drake.errors import ParameterError, UnknownNameError
from saphari_drake.simulation.record.files import atomic_path
from saphari_drake.simulation.runner.command_line import say

BLOCK = 1000  # trials of a file
Columns = dict[str, NDArray[np.float64]]


def run_block(case: str, seed: int, first: int, count: int) -> Columns:
    """Run the trials from `first` on; trial k of a seed is the same everywhere."""
    trial, key = TRIALS[case], list(TRIALS).index(case)
    rows = [trial(np.random.default_rng([seed, key, number])) for number in range(first, first + count)]
    columns = {name: np.array([row[name] for row in rows]) for name in rows[0]}
    return {"trial": np.arange(first, first + count, dtype=float), **columns}


def main(argv: Sequence[str]) -> int:
    """Run blocks that are not there yet, and tell of all; return 0, or 1 if a trial violates a limit."""
    options = _parse(argv)
    cases = options.case or list(TRIALS)
    for case in cases:
        if case not in TRIALS:
            raise UnknownNameError("case", case, TRIALS)
    options.out.mkdir(parents=True, exist_ok=True)
    share = options.trials // len(cases)
    jobs = [(case, first, min(BLOCK, share - first)) for case in cases for first in range(0, share, BLOCK)]
    jobs = [job for job in jobs if not _path(options.out, *job).is_file()]
    start, done = time.perf_counter(), 0
    with ProcessPoolExecutor(options.workers, get_context("spawn")) as pool:
        futures = {pool.submit(run_block, case, options.seed, first, count): (case, first, count)
                   for case, first, count in jobs}  # fmt: skip
        for future in as_completed(futures):
            job = futures.pop(future)
            _write(_path(options.out, *job), future.result())
            done += job[2]
            seconds = time.perf_counter() - start
            left = seconds / done * (sum(count for *_, count in jobs) - done)
            say(f"{job[0]} {job[1] + job[2]}: {done / seconds:.0f} trials/s; about {minutes(left)} left")
    return int(any([_tell(options.out, case) for case in cases]))


def _parse(argv: Sequence[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="sweep arrays", description=__doc__)
    parser.add_argument("--case", action="append", metavar="NAME", help=f"of {', '.join(TRIALS)} (default: all)")
    parser.add_argument("--trials", type=int, default=3000, metavar="N", help="of all cases together (default: 3000)")
    parser.add_argument("--seed", type=int, default=0, metavar="S")
    parser.add_argument("--workers", type=int, default=2, metavar="K", help="processes (default: 2)")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR")
    options = parser.parse_args(argv)
    if options.trials < len(options.case or TRIALS) or options.workers < 1:
        raise ParameterError("--trials", "needs a trial a case at least, and --workers one process")
    return options


def _path(out: Path, case: str, first: int, count: int) -> Path:
    return out / f"{case}_{first:07d}_{count:04d}.parquet"


def _write(path: Path, columns: Columns) -> None:
    pyarrow, parquet = pyarrow_parquet()
    with atomic_path(path) as temporary:
        parquet.write_table(pyarrow.table(columns), temporary)


def _tell(out: Path, case: str) -> bool:
    """Print what all trials of a case come to; return whether one violates a limit."""
    _, parquet = pyarrow_parquet()
    tables = [parquet.read_table(path).to_pydict() for path in sorted(out.glob(f"{case}_*.parquet"))]
    columns = {name: np.concatenate([table[name] for table in tables]) for name in tables[0]}
    bad = columns.pop("violated") > 0.0
    numbers = columns.pop("trial")
    low, high = interval(int(bad.sum()), bad.size)
    say(
        f"{case}: {int(bad.sum())} of {bad.size} trials violate a limit, 95 % interval of the rate "
        f"{low:.2g} … {high:.2g}"
    )
    for name, values in columns.items():
        say(f"  {name:<22} least {values.min():>11.4g}  median {np.median(values):>11.4g}  most {values.max():>11.4g}")
    if bad.any():
        say(f"  violating: {', '.join(f'{number:.0f}' for number in numbers[bad][:20])}")
    return bool(bad.any())
