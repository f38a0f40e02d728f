"""What report.py does with its options."""

from __future__ import annotations

import sys
from argparse import Namespace
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

from experiments.evidence.arm_trials import arm_jobs, run_arms
from experiments.evidence.benchmarks import run_benchmarks
from experiments.evidence.command_line import parse
from experiments.evidence.discovery import find_scripts
from experiments.evidence.fault_trials import fault_summary, recorded_trial, run_faults
from experiments.evidence.gate import check
from experiments.evidence.hazards import hazards_text
from experiments.evidence.page import write_page
from experiments.evidence.progress import Progress
from experiments.evidence.readme import generated, missing
from experiments.evidence.recording import record
from experiments.evidence.results_file import read_results, write_results
from saphari_drake.errors import SaphariError, UnknownNameError
from saphari_drake.simulation.faults.registry import FAULTS
from saphari_drake.simulation.record.files import write_text
from saphari_drake.simulation.runner.command_line import complain, say

DONE, FAILED, BAD_INPUT, INTERRUPTED = 0, 1, 2, 130


class Places(NamedTuple):
    """Where the scripts and the benchmarks are, and what is written."""

    scripts: Path
    benchmarks: Path
    readme: Path

    @property
    def pages(self) -> list[Path]:
        """The README, and the page of results among the docs if there is one."""
        page = self.scripts / "docs" / "results.md"
        return [self.readme, page] if page.is_file() else [self.readme]

    @property
    def results(self) -> Path:
        """File of the experiments' figures."""
        return self.scripts / "results.json"

    @property
    def faults(self) -> Path:
        """File of the trials of faults."""
        return self.scripts / "faults.json"

    @property
    def hazards(self) -> Path:
        """Page of the table of hazards."""
        return self.scripts / "hazards.md"

    @property
    def arms(self) -> Path:
        """File of the runs on other arms."""
        return self.scripts / "arms.json"

    @property
    def times(self) -> Path:
        """File of the benchmarks' rows."""
        return self.scripts / "benchmarks.json"


def main(argv: Sequence[str] | None, places: Places) -> int:
    """Do what the command line says and return the exit status."""
    try:
        return _main(parse(argv), places)
    except (SaphariError, OSError) as error:
        complain("report", error)
        return BAD_INPUT
    except KeyboardInterrupt:
        print("\nreport: interrupted", file=sys.stderr)
        return INTERRUPTED


def _main(options: Namespace, places: Places) -> int:
    broken: list[str] = []
    with ExitStack() as stack:
        out = options.out or Path(stack.enter_context(TemporaryDirectory()))
        keep = options.out is not None
        if options.check:
            scripts = find_scripts(places.scripts)
            lines = check(scripts, options.only, places.results, out, options.jobs, keep, say)
            if keep:
                show_page(places, out)
            return _told(lines, "gate: pass", "gate: FAIL")
        if options.faults:
            broken = record_faults(options, places)
        elif options.arms:
            record_arms(options, places, out, keep)
        elif options.benchmarks:
            record_benchmarks(places, options.only)
        elif not options.tables:
            scripts = find_scripts(places.scripts)
            broken = record(scripts, options.only, options.seeds, places.results, out, options.jobs, keep, say)
        if keep:
            show_page(places, out)
    return _told([*broken, *write_pages(places)], "README written", "README written, without the above")


def record_benchmarks(places: Places, only: Sequence[str]) -> None:
    """Run the benchmarks and keep their rows."""
    recorded = read_results(places.times)
    for name, entry in run_benchmarks(places.benchmarks, only):
        say(name)
        recorded[name] = entry
        write_results(places.times, dict(sorted(recorded.items())))


def record_arms(options: Namespace, places: Places, out: Path, keep: bool) -> None:
    """Run the experiments on other arms and keep what each came to."""
    scripts, recorded = find_scripts(places.scripts), read_results(places.arms)
    jobs = arm_jobs(options.arms, scripts, options.only)
    progress = Progress(jobs, {}, options.jobs)
    for run, entry in run_arms(jobs, scripts, out, options.jobs, keep):
        say(progress.line(run))
        recorded.setdefault(run.job.label, {})[f"{run.job.script}/{run.job.case}"] = entry
        write_results(places.arms, recorded)


def record_faults(options: Namespace, places: Places) -> list[str]:
    """Run the trials of faults and keep what they come to; return a line for each fault that stays silent."""
    for name in options.only:
        if name not in FAULTS:
            raise UnknownNameError("fault", name, FAULTS)
    recorded = read_results(places.faults)
    for case, result in run_faults(str(places.scripts), options.only, options.seeds, options.jobs):
        fault = result["fault"]
        say(f"{case} {fault} seed {result['seed']}: {1e3 * result['reaction']:.0f} ms")
        recorded.setdefault(fault, {}).setdefault(case, {})[str(result["seed"])] = recorded_trial(result)
        write_results(places.faults, recorded)
    return [
        f"silent: {case} {fault}, seeds {silent}"
        for fault, cases in recorded.items()
        for case, trials in cases.items()
        if (silent := fault_summary(trials)["silent_seeds"]) and not FAULTS[fault].bounded
    ]


def show_page(places: Places, out: Path) -> None:
    """Write the page of what is recorded and of what lies below a folder."""
    out.mkdir(parents=True, exist_ok=True)
    say(f"page: {write_page(read_results(places.results), read_results(places.faults), out)}")


def write_pages(places: Places) -> list[str]:
    """Write the generated parts of README and page of results, and the hazards; return a line for what they lack."""
    results, times, faults = (read_results(path) for path in (places.results, places.times, places.faults))
    texts = [page.read_text(encoding="utf-8") for page in places.pages]
    for page, text in zip(places.pages, generated(texts, results, times, faults, read_results(places.arms))):
        write_text(page, text)
    write_text(places.hazards, hazards_text(faults))
    return missing(results, times)


def _told(lines: Sequence[str], well: str, badly: str) -> int:
    for line in lines:
        say(line)
    say(badly if lines else well)
    return FAILED if lines else DONE
