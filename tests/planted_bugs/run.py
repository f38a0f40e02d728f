"""Plant every bug of bugs.toml in a copy of the project and run the tests that have to see it; print list and score.

`python tests/planted_bugs/run.py --help` tells the options. It is no part of the tests' own run. Exit status: 0 all are
seen, 1 some are missed, 2 the tests fail without a bug.
"""

import argparse
import os
import shutil
import subprocess
import sys
import tomllib
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

ROOT = Path(__file__).resolve().parents[2]
COPIED = ("saphari_drake", "diagrams", "models", "tests", "pyproject.toml", "README.md")
LONGEST = 900.0  # s, for the tests of one bug: a bug may also be seen by never ending


@dataclass(frozen=True)
class Bug:
    """One line of a file, what it becomes, and the tests that have to see it."""

    name: str
    file: str
    old: str
    new: str
    tests: list[str]

    def planted(self, text: str) -> str:
        """Return a file's text with the bug; raise ValueError if its line is not there exactly once."""
        lines = text.splitlines(keepends=True)
        rows = [k for k, line in enumerate(lines) if line.strip() == self.old]
        if len(rows) != 1:
            raise ValueError(f"{self.name}: {self.file} has the line {len(rows)} times: {self.old}")
        lines[rows[0]] = lines[rows[0]].replace(self.old, self.new)
        return "".join(lines)


def bugs() -> list[Bug]:
    """Return all bugs."""
    document = tomllib.loads((Path(__file__).parent / "bugs.toml").read_text(encoding="utf-8"))
    return [Bug(**entry) for entry in document["bug"]]


def copy_to(folder: Path) -> None:
    """Copy the project, with its compiled kernels: these are found again by what they are made of."""
    for name in COPIED:
        source = ROOT / name
        copy = shutil.copytree if source.is_dir() else shutil.copy2
        copy(source, folder / name)


def passes(folder: Path, tests: list[str]) -> bool:
    """Run tests in a copy; whether they pass."""
    environment = {**os.environ, "PYTHONPATH": f"{folder}{os.pathsep}{folder / 'diagrams'}", "OMP_NUM_THREADS": "1"}
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", *tests]
    try:
        done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, timeout=LONGEST)
    except subprocess.TimeoutExpired:
        return False
    if done.returncode not in (0, 1, 2):  # 1: a test failed; 2: the bug does not even let them be collected
        raise RuntimeError(f"pytest ended with {done.returncode}: {done.stdout.decode()[-400:]}")
    return done.returncode == 0


def passes_as_it_is(tests: list[str]) -> bool:
    """Whether tests pass in a copy without a bug."""
    with TemporaryDirectory() as name:
        copy_to(Path(name))
        return passes(Path(name), tests)


def seen(bug: Bug) -> bool:
    """Whether a test fails with the bug."""
    with TemporaryDirectory() as name:
        folder = Path(name)
        copy_to(folder)
        path = folder / bug.file
        path.write_text(bug.planted(path.read_text(encoding="utf-8")), encoding="utf-8")
        return not passes(folder, bug.tests)


def main() -> int:
    """Run all and return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", default="", metavar="TEXT", help="bugs with this in their name or file")
    parser.add_argument("--jobs", type=int, default=1, metavar="K", help="bugs at a time (default: 1)")
    parser.add_argument("--unchecked", action="store_true", help="do not run the tests without a bug first")
    options = parser.parse_args()
    chosen = [bug for bug in bugs() if options.only in bug.name or options.only in bug.file]
    tests = sorted({test for bug in chosen for test in bug.tests})
    if not chosen:
        print(f"no bug has '{options.only}' in its name or file", file=sys.stderr)
        return 2
    if not options.unchecked and not passes_as_it_is(tests):
        print("without a bug, a test fails", file=sys.stderr)
        return 2
    missed = []
    with ThreadPoolExecutor(options.jobs) as pool:
        for bug, found in zip(chosen, pool.map(seen, chosen)):
            print(f"{'seen  ' if found else 'MISSED'}  {bug.name} ({bug.file})", flush=True)
            missed += [] if found else [bug.name]
    print(f"{len(chosen) - len(missed)} of {len(chosen)} planted bugs are seen")
    return int(bool(missed))


if __name__ == "__main__":
    sys.exit(main())
