"""Every planted bug still applies, changes something, and names tests that exist; run.py tells whether they see it."""

import ast
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
SPEC = spec_from_file_location("planted_bugs_run", ROOT / "tests" / "planted_bugs" / "run.py")
RUN = module_from_spec(SPEC)
SPEC.loader.exec_module(RUN)
BUGS = RUN.bugs()


@pytest.mark.parametrize("bug", BUGS, ids=lambda bug: bug.name)
def test_it_applies(bug):
    text = (ROOT / bug.file).read_text(encoding="utf-8")
    planted = bug.planted(text)
    assert ast.dump(ast.parse(planted)) != ast.dump(ast.parse(text))
    assert sum(a != b for a, b in zip(text.splitlines(), planted.splitlines())) == 1
    assert bug.tests and all((ROOT / test).exists() for test in bug.tests)


def test_every_room_has_some():
    rooms = {bug.file.split("/")[1] for bug in BUGS}
    assert {"math", "robots", "estimation", "perception", "control", "safety", "simulation"} <= rooms
    assert len(BUGS) >= 40 and len({bug.name for bug in BUGS}) == len(BUGS)
