"""Every notebook runs as a script, holds what it claims, has its pair, and is on the page of tutorials."""

import runpy
from pathlib import Path

import jupytext
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


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_its_pair_for_jupyter_is_the_same(path):
    """Cells and kernel are those of the script, and nothing has been run: jupytext --to ipynb --update FILE.py."""
    script, pair = (jupytext.read(path.with_suffix(suffix)) for suffix in (".py", ".ipynb"))
    assert [(c.cell_type, c.source) for c in pair.cells] == [(c.cell_type, c.source) for c in script.cells]
    assert pair.metadata.kernelspec == script.metadata.kernelspec
    assert pair.metadata.jupytext.formats == script.metadata.jupytext.formats == "ipynb,py:percent"
    code = [cell for cell in pair.cells if cell.cell_type == "code"]
    assert code and all(cell.outputs == [] and cell.execution_count is None for cell in code)


def test_no_pair_is_alone():
    assert sorted((DIAGRAMS / "notebooks").glob("*.ipynb")) == [path.with_suffix(".ipynb") for path in NOTEBOOKS]


def test_every_notebook_is_told_of():
    assert len(NOTEBOOKS) >= 6
    page = (DIAGRAMS / "docs" / "tutorials.rst").read_text(encoding="utf-8")
    for path in NOTEBOOKS:
        assert f"notebooks/{path.name}" in page
        text = path.read_text(encoding="utf-8")
        assert (text.startswith("# ---\n# jupyter:") and "# %% [markdown]\n# # " in text and "\nassert " in text) or (
            "assert_allclose" in text
        )
