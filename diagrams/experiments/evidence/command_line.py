"""The command line of report.py."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import NoReturn

from saphari_drake.errors import ParameterError, SaphariError

EPILOG = """examples:
  python diagrams/report.py                                     every case on seeds 0, 1 and 2
  python diagrams/report.py --seeds 0:20 --only contact_impedance/natural
  python diagrams/report.py --only nmpc_manipulator --out runs  one script's cases; keeps figures and replays
  python diagrams/report.py --benchmarks                        the table of speed; on a machine that does nothing else
  python diagrams/report.py --faults --seeds 0:5                every fault on four experiments; and hazards.md
  python diagrams/report.py --arms my_arm.urdf other.urdf       the experiments on arms of your own, shortened
  python diagrams/report.py --tables                            the README alone, from what is recorded
  python diagrams/report.py --check                             the gate
  python diagrams/report.py --tables --out runs                 runs/report.html, with the sweeps and replays in runs

Figures go to results.json, faults.json, arms.json and benchmarks.json in diagrams; the README's tables are written
from these. What a selection leaves out stays as it was recorded. The gate runs every case with its default seed, and
the main experiment with a seed made from the date as well. It fails if a run does not end with 0 or if a figure of a
default seed is further off its recorded value than the difference allowed for it: its spread over the seeds, at least
5 % of the value or 2 % of its bound, 10 % of a value without one, and what the simulated sensors tell apart (1e-6 m
or rad, 0.01 N or Nm). Timings are recorded and never compared.
Exit status: 0 done (with --check: passed), 1 a run could not be made, a figure of the README is not recorded or the
gate failed, 2 input that cannot be used."""


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        raise SaphariError(f"{message} (--help lists the options)")


def parse(argv: Sequence[str] | None) -> argparse.Namespace:
    """Return the options; `seeds` as a list of different numbers, in the order given."""
    parser = _Parser(
        prog="report",
        description="Run the experiments over seeds, record their figures and write the README's tables; or check.",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        epilog=EPILOG,
    )
    add = parser.add_argument
    add("--seeds", nargs="+", metavar="N", help="seeds, or ranges as 0:20 (default: 0 1 2); the default seed joins")
    add("--only", action="append", default=[], metavar="SCRIPT[/CASE]", help="run this alone; may be repeated")
    add("--jobs", type=int, default=2, metavar="K", help="runs at a time, each on one thread (default: 2)")
    add("--out", type=Path, metavar="DIR", help="keep the files of every run, and write DIR/report.html")
    mode = parser.add_mutually_exclusive_group()
    mode.add_argument("--tables", action="store_true", help="run nothing; write the README's tables again")
    mode.add_argument("--benchmarks", action="store_true", help="run tests/benchmarks, or those that --only names")
    mode.add_argument("--faults", action="store_true", help="run every fault, or those that --only names")
    mode.add_argument(
        "--arms", nargs="+", type=Path, metavar="MODEL", help="run the experiments on other arms, shortened"
    )
    mode.add_argument("--check", action="store_true", help="the gate: run with default seeds and compare")
    options = parser.parse_args(argv)
    if options.seeds and (options.tables or options.benchmarks or options.check):
        raise ParameterError("--seeds", "goes with none of --tables, --benchmarks and --check")
    if options.jobs < 1:
        raise ParameterError("--jobs", f"must be at least 1, got {options.jobs}")
    options.seeds = list(dict.fromkeys(seed for text in options.seeds or ["0:3"] for seed in _seeds(text)))
    return options


def _seeds(text: str) -> range:
    first, colon, last = text.partition(":")
    if not (first.isdigit() and (last.isdigit() or not colon)):
        raise ParameterError("--seeds", f"'{text}' is neither a number nor a range such as 0:20")
    return range(int(first), int(last) if colon else int(first) + 1)
