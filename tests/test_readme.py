"""The README's example runs as printed, its commands are there, and its figures are those that are recorded."""

import re
from pathlib import Path

import pytest
from experiments.evidence.markers import without_blocks
from experiments.evidence.readme import generated, missing
from experiments.evidence.results_file import read_results

ROOT = Path(__file__).parents[1]
PAGES = [(ROOT / name).read_text(encoding="utf-8") for name in ("README.md", "diagrams/docs/results.md")]
README = PAGES[0]
RESULTS = read_results(ROOT / "diagrams" / "results.json")
BENCHMARKS = read_results(ROOT / "diagrams" / "benchmarks.json")
FAULTS = read_results(ROOT / "diagrams" / "faults.json")
ARMS = read_results(ROOT / "diagrams" / "arms.json")


def numbers_typed(text):
    """Return the table rows outside the generated parts that hold a number which is no code."""
    rows = [line for line in without_blocks(text).splitlines() if line.startswith("|")]
    return [row for row in rows if re.search(r"\d", re.sub(r"`[^`]*`", "", row))]


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


def test_generated_parts_are_what_is_recorded():
    """`report.py --tables` would change nothing."""
    assert generated(PAGES, RESULTS, BENCHMARKS, FAULTS, ARMS) == PAGES


def test_every_figure_of_the_readme_is_recorded():
    """Each row of each generated table has its figures."""
    lines = missing(RESULTS, BENCHMARKS)
    assert not lines, "\n".join(lines)


def test_no_table_holds_a_typed_number():
    """Numbers stand between markers alone; `code` may hold digits."""
    assert [row for page in PAGES for row in numbers_typed(page)] == []


@pytest.mark.parametrize("row", ["| error | 1.8 % |", "| `nmpc` 3 | – |"])
def test_a_typed_number_is_found(row):
    assert numbers_typed(f"{README}\n{row}\n") == [row]


def test_a_changed_figure_is_found():
    """One digit of a generated part is enough."""
    part = re.search(r"<!-- results:made -->\n(.*?)<!-- /results -->", README, re.DOTALL)
    digit = re.search(r"\d", part[1])
    at = part.start(1) + digit.start()
    changed = README[:at] + str((int(digit[0]) + 1) % 10) + README[at + 1 :]
    assert generated([changed, *PAGES[1:]], RESULTS, BENCHMARKS, FAULTS, ARMS) == PAGES and changed != README
