"""Every notebook runs as a script, holds what it claims, and is one that jupytext and the page of tutorials know."""

import runpy
from pathlib import Path

import matplotlib.pyplot as plt
import pytest

DIAGRAMS = Path(__file__).resolve().parents[1] / "diagrams"
NOTEBOOKS = sorted((DIAGRAMS / "notebooks").glob("*.py"))


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebook_runs(path, monkeypatch):
    """Its last cell asserts what its text says."""
    monkeypatch.setenv("MPLBACKEND", "agg")
    plt.switch_backend("agg")
    runpy.run_path(str(path))
    plt.close("all")


def test_every_notebook_is_told_of():
    assert len(NOTEBOOKS) >= 6
    page = (DIAGRAMS / "docs" / "tutorials.rst").read_text(encoding="utf-8")
    for path in NOTEBOOKS:
        assert f"notebooks/{path.name}" in page
        text = path.read_text(encoding="utf-8")
        assert (text.startswith("# ---\n# jupyter:") and "# %% [markdown]\n# # " in text and "\nassert " in text) or (
            "assert_allclose" in text
        )
