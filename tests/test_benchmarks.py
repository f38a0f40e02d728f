"""Each benchmark finds all that it names when it is loaded; what they measure is no test."""

import subprocess
import sys
from pathlib import Path

import pytest

FILES = sorted((Path(__file__).parent / "benchmarks").glob("*.py"))


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_a_benchmark_tells_what_it_does(file):
    done = subprocess.run([sys.executable, str(file), "--help"], capture_output=True, text=True, timeout=120.0)
    assert done.returncode == 0, done.stderr
    assert "usage" in done.stdout
