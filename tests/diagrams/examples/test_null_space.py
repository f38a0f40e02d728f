"""The five methods on an arm that is not ours, each in twenty lines of code."""

import runpy
from pathlib import Path

import pytest
from arms import EXAMPLES as ROBOTS

EXAMPLES = Path(__file__).parents[3] / "diagrams" / "examples"
PANDA = str(ROBOTS / "panda_description" / "urdf" / "panda.urdf"), "0", "-30", "0", "-120", "0", "90", "45"
SAID = {
    "null_space": "panda: the end effector is 0.00",
    "predictive_control": "panda: 0.",
    "reverse_priority": "panda: joint 3 turned by 0.2",
    "hand_guiding": "panda: led up by ",
    "contact_impedance": "panda: HOLD",
}


@pytest.mark.skipif(not ROBOTS.is_dir(), reason="example-robot-data is not installed")
@pytest.mark.parametrize("name", SAID)
def test_a_method_runs_on_a_foreign_arm(name, capsys, monkeypatch):
    monkeypatch.setattr("sys.argv", [name, *PANDA])
    runpy.run_path(str(EXAMPLES / f"{name}.py"))
    assert SAID[name] in capsys.readouterr().out


@pytest.mark.parametrize("name", SAID)
def test_it_has_twenty_lines_of_code(name):
    lines = (EXAMPLES / f"{name}.py").read_text(encoding="utf-8").splitlines()
    code = [line for line in lines if line.strip() and not line.startswith(("from ", "import ", '"""'))]
    assert len(code) <= 20
