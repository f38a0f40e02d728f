"""The command line that every experiment shares: its options, and what it tells the user."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NoReturn

from saphari_drake.errors import SaphariError
from saphari_drake.simulation.faults.registry import listed


def say(text: str) -> None:
    """Print to stdout; a reader who has gone away (as `head` does) does not end the run."""
    try:
        print(text, flush=True)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def complain(program: str, error: Exception, where: str = "") -> None:
    """Tell an error in one line on stderr."""
    text = "there is not enough memory for this" if isinstance(error, MemoryError) else str(error)
    if isinstance(error, OSError) and error.strerror:
        text = f"{error.filename}: {error.strerror}" if error.filename else error.strerror
    print(f"{program}: error: {where}{' '.join(text.split())}", file=sys.stderr, flush=True)


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        raise SaphariError(f"{message} (--help lists the options)")


def _path(text: str) -> Path:
    if not text:
        raise argparse.ArgumentTypeError("needs a path, got ''")
    return Path(text)


def parser(program: str, summary: str, cases: Mapping[str, str], accepts_model: bool) -> argparse.ArgumentParser:
    """Return the parser of the options that every experiment takes; it raises instead of leaving the process."""
    script, first = f"python diagrams/{program}.py", next(iter(cases))
    result = _Parser(
        prog=program,
        description=summary,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        epilog=f"""examples:
  {script} --list-cases
  {script} --case {first} --out runs
  {script} --case {first} --set seed=3 --set duration=2.5
  {script} --scenario runs/{first}/scenario.yaml

Every name in scenario.yaml can be set, nested ones with dots: --set controller.gain=20.
Order: the case's own values, then --quick, --scenario, --seed, --duration, --plant and --model, then --set.
Faults (--set faults=[NAME, ...], begin at --set fault_time=S, sizes in fault_sizes), where the case has the part:
{listed()}
Exit status: 0 all bounds met, 1 some missed, 2 input that cannot be used, 130 or 143 told to end by Ctrl-C or SIGTERM,
which keeps the log so far. Timing figures (*_ms_*) never decide.""",
    )
    add = result.add_argument
    add("--case", action="append", metavar="NAME", help="case to run; may be repeated (default: all)")
    add("--list-cases", action="store_true", help="list the cases and stop")
    add("--seed", type=int, metavar="N", help="seed of everything random")
    add("--quick", action="store_true", help="the shortest run that gives a figure; judged by what happens in it")
    add("--duration", type=float, metavar="S", help="simulated time (s)")
    add("--set", action="append", default=[], metavar="PATH=VALUE", help="set a parameter by its dotted name")
    add("--scenario", type=_path, metavar="FILE.yaml", help="parameters, all or some; a case named there is run")
    model_help = "URDF or SDF of another robot" if accepts_model else "not accepted by this experiment"
    add("--model", type=_path, metavar="FILE", help=model_help)
    add("--plant", metavar="NAME", help="ideal (default), or realistic: friction, delay, noise and a model that is off")
    add("--out", type=_path, metavar="DIR", help="write metrics, log, figure, replay and scenario to DIR/CASE")
    also: dict[str, Any] = {"action": "append_const", "dest": "also", "default": []}
    add("--mcap", const="mcap", help="write run.mcap too, for Foxglove or Rerun (extra 'mcap')", **also)
    add("--no-pictures", const="no-pictures", help="with --out: no figure and no replay, which can take long", **also)
    add("--gif", const="gif", help="write replay.gif too, an animated picture", **also)
    add("--meshcat", action="store_true", help="live view in a browser; prints its address")
    add("--graphviz", type=_path, metavar="FILE", help="write the block diagram (.dot, .svg, .png, .pdf) and stop")
    return result
