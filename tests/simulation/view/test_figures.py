"""Figures: one time axis, the same colours for X, Y, Z, no change of the user's matplotlib."""

import re
from pathlib import Path

import matplotlib
import numpy as np
import pytest
from matplotlib.mathtext import MathTextParser

from saphari_drake.simulation.record.log import Log
from saphari_drake.simulation.view.figures import XYZ, Line, Panel, Shade, intervals, time_panels


@pytest.fixture
def log():
    log = Log(np.linspace(0.0, 1.0, 101))
    log.add("force", np.outer(log.time, [1.0, 2.0, 3.0]), "N")
    log.add("residual", np.outer(log.time, np.arange(7)), "Nm")
    log.add("contact", (log.time > 0.3) & (log.time < 0.6))
    return log


def test_panels_share_time_and_carry_titles_units_and_number(log, tmp_path):
    settings = dict(matplotlib.rcParams)
    panels = [
        Panel("Residual", ["residual"], "r [Nm]"),
        Panel(
            "Force", ["force", Line("force", 2, "Z mm", style="--", scale=1e3)], "F [N]", {"limit": 15.0}, (0.0, 20.0)
        ),
    ]
    shade = Shade(intervals(log.time, log["contact"]), "in contact")
    figure = time_panels(log, panels, "Figure 12: natural inertia", shade)
    top, bottom = figure.axes
    assert "Figure 12" in figure.get_suptitle()
    assert top.get_title(loc="left") == "Residual" and bottom.get_ylabel() == "F [N]"
    assert bottom.get_xlabel() == "time [s]" and top.get_shared_x_axes().joined(top, bottom)
    assert tuple(line.get_color() for line in bottom.lines[:3]) == XYZ and bottom.lines[3].get_color() == XYZ[2]
    assert bottom.lines[3].get_ydata()[-1] == pytest.approx(3000.0)
    assert len(top.lines) == 7 and "in contact" in top.get_legend_handles_labels()[1]
    assert bottom.get_legend_handles_labels()[1] == ["X", "Y", "Z", "Z mm", "limit"]
    figure.savefig(tmp_path / "figure.png")
    assert dict(matplotlib.rcParams) == settings


def test_intervals_run_from_first_to_last_sample():
    assert intervals([0, 1, 2, 3, 4], [1, 1, 0, 1, 0]) == [(0.0, 1.0), (3.0, 3.0)]
    assert intervals([0, 1], [0, 0]) == [] and intervals([], []) == []


def test_unknown_names_are_told(log):
    with pytest.raises(KeyError, match="no signal 'speed'; there are: force, residual, contact"):
        time_panels(log, [Panel("", ["speed"], "")], "")
    with pytest.raises(KeyError, match="no column of 'force' '3'; there are: 0, 1, 2"):
        time_panels(log, [Panel("", [Line("force", 3)], "")], "")


def test_formulas_of_labels_can_be_drawn():
    """Those of all scripts: a mistake would show only when a figure is saved."""
    folder, parser = Path(__file__).parents[3] / "diagrams" / "experiments", MathTextParser("agg")
    labels = [
        label
        for path in folder.rglob("*.py")
        for label in re.findall(r'r"([^"\n]*\$[^"\n]+\$[^"\n]*)"', path.read_text())
    ]
    assert labels
    for label in labels:
        parser.parse(label)
