"""The examples run, are short, and say what they promise."""

import runpy
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[3] / "diagrams" / "examples"
SAID = {
    "speed_separation": ("1.00 m away: 1.00", "0.25 m away: 0.00"),
    "power_force": ("free: ", "clamped: "),
    "supervisor": ("1.0 s: FREE because of CLEAR", "1.5 s: SLOWED", "2.0 s: STOP", "3.0 s: CONTACT", "5.0 s: FREE"),
}


@pytest.mark.parametrize("name", SAID)
def test_an_example_runs(name, capsys):
    path = EXAMPLES / f"{name}.py"
    runpy.run_path(str(path))
    said = capsys.readouterr().out
    assert all(text in said for text in SAID[name]), said


@pytest.mark.parametrize("name", SAID)
def test_an_example_has_twenty_lines_of_code(name):
    lines = (EXAMPLES / f"{name}.py").read_text().splitlines()
    code = [line for line in lines if line.strip() and not line.startswith(("from ", "import ", '"""'))]
    assert len(code) <= 20, len(code)
