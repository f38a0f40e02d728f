"""The README's example runs as it is printed, and its two commands are there."""

import re
from pathlib import Path

README = (Path(__file__).parents[1] / "README.md").read_text()


def test_the_wiring_example_runs():
    """The printed code builds and simulates without a change."""
    (code,) = re.findall(r"```python\n(.*?)```", README, flags=re.DOTALL)
    scope = {}
    exec(compile(code, "README.md", "exec"), scope)
    assert scope["detector"].GetOutputPort("contact").size() == 1


def test_the_two_commands_are_printed():
    """One sets up and runs the main experiment, one sets up and passes the tests."""
    commands = re.findall(r"```sh\n(.*?)\n```", README, flags=re.DOTALL)
    assert commands[0].endswith("diagrams/contact_impedance.py --out RUN")
    assert commands[1].endswith("pytest")
    assert all(command.startswith("python3 -m venv .venv && .venv/bin/pip install -e") for command in commands[:2])
