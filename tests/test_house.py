"""The house as it is meant: who may import whom, how long a file may be, where its tests are."""

import ast
from collections.abc import Iterator
from itertools import chain
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGE = "saphari_drake"
# What each room may import beside itself and the modules at the top, which everybody may import.
METHODS = ("estimation", "perception", "control", "safety")
MAY_IMPORT = {
    "": (),
    "math": (),
    "robots": ("math",),
    **dict.fromkeys(METHODS, ("math", "robots")),
    **dict.fromkeys(("pipelines", "stations", "simulation"), ("math", "robots", *METHODS)),
}
LONGEST = 250


def modules() -> list[Path]:
    """Return all modules of the library, relative to it."""
    return sorted(path.relative_to(ROOT / PACKAGE) for path in (ROOT / PACKAGE).rglob("*.py"))


def imported(tree: ast.AST) -> Iterator[str]:
    """Return the modules of this project that a module imports, wherever it does."""
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
            yield node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names)
        elif isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)


def room(parts: tuple[str, ...]) -> tuple[str, str]:
    """Return room and chamber of a module by its place: ("control", "nmpc"); chambers matter in control alone."""
    inside = parts[0] if len(parts) > 1 else ""
    return inside, parts[1] if inside == "control" and len(parts) > 2 else ""


def trespasses(place: Path, source: str) -> list[str]:
    """Return the imports of a module that the order forbids."""
    here, chamber = room(place.parts)
    found = []
    for name in imported(ast.parse(source)):
        if name.split(".")[0] == "experiments":
            found.append(name)
        if not name.startswith(f"{PACKAGE}."):
            continue
        path = ROOT / PACKAGE / Path(*name.split(".")[1:])
        if not path.with_suffix(".py").is_file() and not path.is_dir():
            continue  # a name inside a module, which is listed by itself
        there, other = room((*name.split(".")[1:], *([""] if path.is_dir() else [])))
        if there not in ("", here, *MAY_IMPORT[here]) or (there == here == "control" and other != chamber):
            found.append(name)
    return found


@pytest.mark.parametrize("place", modules(), ids=str)
def test_imports_run_one_way(place):
    """math ← robots ← {estimation, perception, control, safety} ← {pipelines, stations, simulation} ← diagrams."""
    assert trespasses(place, (ROOT / PACKAGE / place).read_text(encoding="utf-8")) == []


@pytest.mark.parametrize(
    ("place", "line"),
    [
        ("math/tree.py", "from saphari_drake.robots.model import RobotModel"),
        ("control/nmpc/law.py", "import saphari_drake.safety.contact_monitor"),
        ("control/nmpc/law.py", "from saphari_drake.control.contact import impedance"),
        ("control/nmpc/law.py", "from saphari_drake.control import joint_servo"),
        ("pipelines/contact.py", "def f():\n    from saphari_drake.simulation.world import cell"),
        ("errors.py", "from saphari_drake.math.tree import link_poses"),
        ("systems.py", "import experiments.contact.cell"),
    ],
)
def test_a_forbidden_import_is_seen(place, line):
    assert trespasses(Path(place), line)


def sources() -> list[Path]:
    """Return all Python files of the project, relative to its folder."""
    files = chain.from_iterable((ROOT / folder).rglob("*.py") for folder in (PACKAGE, "diagrams", "tests"))
    return sorted(path.relative_to(ROOT) for path in files)


def test_files_are_short():
    """Of the library and the scripts none is longer than a reader keeps in mind."""
    lines = {path: len((ROOT / path).read_text(encoding="utf-8").splitlines()) for path in sources()}
    assert {str(path): n for path, n in lines.items() if path.parts[0] != "tests" and n > LONGEST} == {}


def test_tests_stand_where_their_modules_stand():
    """tests/control/nmpc/test_law*.py is for saphari_drake/control/nmpc/law.py; helpers of tests stand at the top."""
    astray = []
    for path in sources():
        if path.parts[0] != "tests" or len(path.parts) == 2 or path.parts[1] in ("benchmarks", "planted_bugs"):
            continue
        home = ROOT / (Path(*path.parts[1:-1]) if path.parts[1] == "diagrams" else Path(PACKAGE, *path.parts[1:-1]))
        names = [file.stem for file in home.glob("*.py")]
        subject = path.stem.removeprefix("test_")
        if not path.stem.startswith("test_") or not any(f"{subject}_".startswith(f"{name}_") for name in names):
            astray.append(str(path))
    assert astray == []


def test_every_room_is_in_the_order():
    folders = {path.name for path in (ROOT / PACKAGE).iterdir() if (path / "__init__.py").is_file()}
    assert folders == {name for name in MAY_IMPORT if name}
