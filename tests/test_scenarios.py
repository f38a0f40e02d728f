"""Every scenario of every script can be written as text, read again as the same, and shortened."""

import importlib.util
import sys
from pathlib import Path

import pytest
from experiments.evidence.discovery import DEFINES
from pydrake.common.yaml import yaml_dump_typed

from saphari_drake.simulation.runner.scenario import checked, load_tree, merged, to_tree

DIAGRAMS = Path(__file__).parents[1] / "diagrams"
SCRIPTS = [path for path in sorted(DIAGRAMS.glob("*.py")) if DEFINES.search(path.read_text(encoding="utf-8"))]


@pytest.mark.parametrize("path", SCRIPTS, ids=lambda path: path.stem)
def test_scenarios_are_written_and_read(path, tmp_path):
    spec = importlib.util.spec_from_file_location(f"scenarios_{path.stem}", path)
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    for case in module.EXPERIMENT.cases:
        scenario = module.EXPERIMENT.scenario_for(case)
        (tmp_path / "scenario.yaml").write_text(yaml_dump_typed(scenario), encoding="utf-8")
        again = merged(module.EXPERIMENT.scenario_for(case), load_tree(tmp_path / "scenario.yaml"))
        assert to_tree(again) == to_tree(scenario)
        module.EXPERIMENT.quick(again)
        assert checked(again).duration <= scenario.duration and to_tree(again) != to_tree(scenario)
