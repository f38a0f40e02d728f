"""The README with its generated parts as the recorded results give them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from experiments.evidence import benchmarks as speed
from experiments.evidence import readme_tables as tables
from experiments.evidence.arm_trials import arms_table
from experiments.evidence.fault_trials import faults_table
from experiments.evidence.markers import with_blocks
from experiments.evidence.readme_rows import EXPERIMENTS, SPEED_TABLE
from experiments.evidence.results_file import Results


def generated(
    text: str,
    results: Results,
    benchmarks: Mapping[str, Any],
    faults: Mapping[str, Any],
    arms: Mapping[str, Any],
) -> str:
    """Return the README `text` with its generated parts renewed; rows that are not recorded are left out."""
    blocks = {
        "made": tables.made_text(results),
        "experiments": tables.experiments_table(results, EXPERIMENTS),
        "short": tables.short_table(results),
        "faults": faults_table(faults),
        "arms": arms_table(arms),
        "speed_made": speed.speed_made_text(benchmarks),
        "speed": speed.speed_table(benchmarks, SPEED_TABLE),
    }
    return with_blocks(text, blocks)


def missing(results: Results, benchmarks: Mapping[str, Any]) -> list[str]:
    """Return a line for each figure that the README shows and that is not recorded."""
    lines = [line for row in EXPERIMENTS for line in tables.missing(results, row)]
    return lines + [line for row in SPEED_TABLE for line in speed.missing(benchmarks, row)]
