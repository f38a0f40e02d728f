"""Run cases over seeds and keep what they show in the file of results."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from experiments.evidence.discovery import REALISTIC, Script, select
from experiments.evidence.progress import Progress
from experiments.evidence.results_file import Results, merge, read_results, write_results
from experiments.evidence.runs import Job, Run, run_all
from experiments.evidence.summary import summarize_case

Say = Callable[[str], None]


def record(
    scripts: Mapping[str, Script],
    only: Sequence[str],
    seeds: Sequence[int],
    results_path: Path,
    out: Path,
    workers: int,
    keep: bool,
    say: Say,
) -> list[str]:
    """Run the selected cases and write the file of results after each that is complete.

    Returns
    -------
    list of str
        A line for each run that could not be made; what was recorded of its case stays.
    """
    pairs, every = select(scripts, only), select(scripts, [])
    jobs = [Job(*pair, seed) for pair in pairs for seed in seeds_of(scripts, pair, seeds)]
    progress = Progress(jobs, seconds_of(read_results(results_path)), workers)
    paths = {name: script.path for name, script in scripts.items()}
    done: dict[tuple[str, str], list[Run]] = {pair: [] for pair in pairs}
    broken = []
    for run in run_all(jobs, paths, out, workers, keep):
        say(progress.line(run))
        pair = run.job.script, run.job.case
        done[pair].append(run)
        if not run.complete:
            broken.append(f"{run.job.name}: exit status {run.status}, not recorded: {run.complaint or 'no metrics'}")
        elif len(done[pair]) == len(seeds_of(scripts, pair, seeds)) and all(each.complete for each in done[pair]):
            script = scripts[pair[0]]
            summary = summarize_case(done[pair], script.default_seeds[pair[1]], pair[1] in script.seedless)
            write_results(results_path, merge(read_results(results_path), {pair: summary}, every))
    return broken


def seeds_of(scripts: Mapping[str, Script], pair: tuple[str, str], seeds: Sequence[int]) -> list[int]:
    """Return the seeds of a case: its default seed, and the given ones where a seed changes something.

    On the realistic plant it is the default seed alone, for time.
    """
    script, case = scripts[pair[0]], pair[1]
    alone = case in script.seedless or case.endswith(REALISTIC)
    return sorted({script.default_seeds[case], *(() if alone else seeds)})


def seconds_of(results: Results) -> dict[tuple[str, str], float]:
    """Return the recorded time of a run of each case (s)."""
    return {(script, case): summary["seconds"] for script, cases in results.items() for case, summary in cases.items()}
