"""diagrams/contact_impedance.py from the command line: bad input is one clear line and status 2."""

import importlib.util
import sys
from pathlib import Path

import pytest
from pydrake.common.yaml import yaml_dump_typed, yaml_load_typed

from saphari_drake.simulation.runner.experiment import main

SCRIPT = Path(__file__).parents[2] / "diagrams" / "contact_impedance.py"


@pytest.fixture(scope="module")
def script():
    spec = importlib.util.spec_from_file_location("contact_impedance", SCRIPT)
    module = importlib.util.module_from_spec(spec)
    sys.modules["contact_impedance"] = module
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize(
    "arguments, words",
    [
        (["--case", "unnatural"], ["unnatural", "natural, modified, recorded"]),
        (["--set", "system.pipeline.controller.M_d=[1, -1, 1]"], ["controller.M_d", "positive definite"]),
        (["--set", "system.pipeline.controller.K_p=-5"], ["K_p", "negative"]),
        (["--set", "system.pipeline.controler.K_p=5"], ["controler", "controller"]),
        (["--set", "system.camera.rate=fast"], ["rate"]),
        (["--case", "natural", "--set", "robot=puma"], ["puma", "lwr4"]),
        (["--case", "natural", "--model", "missing.urdf"], ["missing.urdf"]),
        (["--case", "recorded", "--set", "recording.file=nowhere.csv"], ["nowhere.csv"]),
        (["--scenario", "nowhere.yaml"], ["nowhere.yaml"]),
        (["--seed", "-1"], ["seed"]),
    ],
)
def test_bad_input_is_one_line_and_status_2(script, capsys, arguments, words):
    """The line says what is wrong and what exists instead; there is no traceback."""
    assert main(script.EXPERIMENT, arguments) == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1
    for word in words:
        assert word in lines[0]


@pytest.mark.parametrize("change", ["inertia", "effort", "garbage"])
def test_an_unusable_model_is_one_line(script, capsys, tmp_path, change):
    """A URDF that lacks inertia or effort limits, or does not parse, is named with what it lacks."""
    link = "<inertial><mass value='1'/><inertia ixx='1' iyy='1' izz='1' ixy='0' ixz='0' iyz='0'/></inertial>"
    limit = "<limit lower='-1' upper='1' velocity='1' effort='10'/>"
    if change == "inertia":
        link = ""
    if change == "effort":
        limit = "<limit lower='-1' upper='1' velocity='1'/>"
    text = (
        f"<robot name='r'><link name='base'/><link name='arm'>{link}</link><joint name='elbow' type='revolute'>"
        f"<parent link='base'/><child link='arm'/><axis xyz='0 1 0'/>{limit}</joint></robot>"
    )
    path = tmp_path / "robot.urdf"
    path.write_text("<robot" if change == "garbage" else text)
    assert main(script.EXPERIMENT, ["--case", "natural", "--model", str(path)]) == 2
    error = capsys.readouterr().err.strip()
    assert len(error.splitlines()) == 1
    assert {"inertia": "mass", "effort": "effort limit", "garbage": "robot.urdf"}[change] in error


def test_cases_are_listed(script, capsys):
    """--list-cases names them all."""
    assert main(script.EXPERIMENT, ["--list-cases"]) == 0
    assert [line.split()[0] for line in capsys.readouterr().out.splitlines()] == list(script.CASES)


@pytest.mark.parametrize("case", ["natural", "modified", "recorded", "random"])
def test_scenarios_load_with_drake_s_own_loader(script, case):
    """`yaml_load_typed` reads back what `yaml_dump_typed` wrote."""
    text = yaml_dump_typed(script.scenario_for(case))
    assert yaml_dump_typed(yaml_load_typed(schema=script.ContactImpedanceScenario, data=text)) == text


def test_the_diagram_is_drawn(script, tmp_path):
    """--graphviz shows the systems by their names."""
    path = tmp_path / "diagram.dot"
    assert main(script.EXPERIMENT, ["--case", "natural", "--graphviz", str(path)]) == 0
    text = path.read_text()
    for name in ("momentum_observer", "contact_localizer", "contact_monitor", "controller", "human_hand"):
        assert name in text
