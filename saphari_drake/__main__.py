"""What is here: ``python -m saphari_drake`` lists experiments, robots, and the extras with what they lack."""

from __future__ import annotations

import ast
import contextlib
import inspect
import re
import sys
from importlib import metadata
from pathlib import Path

import saphari_drake


def main() -> int:
    """Print the list; return the exit status."""
    with contextlib.suppress(BrokenPipeError):  # a reader who has gone away
        print(f"saphari_drake {saphari_drake.__version__}: {saphari_drake.__doc__}\n")
        scripts = experiments()
        if scripts:
            _rows("experiments", [(str(path), summary) for path, summary in scripts])
            print(f"  python {scripts[0][0]} --help tells the options that all of them take\n")
        else:
            print("experiments: none here; they are the scripts in diagrams/ of the project's sources\n")
        robots = [saphari_drake.lwr4, saphari_drake.omnirob, saphari_drake.planar_6r]
        _rows(
            "robots",
            [
                (f"saphari_drake.{robot.__name__}()", _first_line(inspect.getdoc(robot)).removeprefix("Return "))
                for robot in robots
            ],
        )
        print('  saphari_drake.RobotModel("my_arm.urdf") loads yours\n')
        _rows("extras", [(name, _told(name, missing)) for name, missing in extras().items()])
    return 0


def experiments() -> list[tuple[Path, str]]:
    """Return the scripts in ``diagrams/``, here or beside the package, each with the first line of its docstring."""
    for folder in (Path("diagrams"), Path(saphari_drake.__file__).parents[1] / "diagrams"):
        texts = {path: path.read_text(encoding="utf-8") for path in sorted(folder.glob("*.py"))}
        if texts:
            return [(path, _first_line(ast.get_docstring(ast.parse(text)))) for path, text in texts.items()]
    return []


def extras() -> dict[str, list[str]]:
    """Return the packages that each extra of the installed distribution lacks, as its metadata tell."""
    lacks: dict[str, list[str]] = {}
    with contextlib.suppress(metadata.PackageNotFoundError):
        for requirement in metadata.requires("saphari_drake") or ():
            extra = re.search(r"extra == ['\"]([\w-]+)['\"]", requirement)
            name = re.match(r"[\w.-]+", requirement)
            if extra and name:
                lacks.setdefault(extra[1], []).extend([] if _installed(name[0]) else [name[0]])
    return lacks


def _installed(package: str) -> bool:
    try:
        return bool(metadata.version(package))
    except metadata.PackageNotFoundError:
        return False


def _told(extra: str, missing: list[str]) -> str:
    if not missing:
        return "installed"
    return f"without {', '.join(missing)}: pip install 'saphari_drake[{extra}]'"


def _first_line(text: str | None) -> str:
    return (text or "").partition("\n")[0]


def _rows(title: str, rows: list[tuple[str, str]]) -> None:
    width = max((len(name) for name, _ in rows), default=0)
    print(f"{title}:" if rows else f"{title}: none")
    for name, text in rows:
        print(f"  {name:<{width}}  {text}")


if __name__ == "__main__":
    sys.exit(main())
