"""Figures in one look: stacked panels that share the time axis, thin grid, the same colours for X, Y, Z everywhere."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray

from saphari_drake.errors import UnknownNameError
from saphari_drake.simulation.record.log import Log

# Colours that stay apart for every common kind of colour blindness (Okabe and Ito).
X, Y, Z = "#D55E00", "#009E73", "#0072B2"
XYZ = (X, Y, Z)
DARK = ("#6E3000", "#00402F", "#002A45")  # X, Y, Z of what is drawn dotted over them
CYCLE = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
BOUND, SHADE = "#666666", "#BBBBBB"

STYLE = {
    "font.size": 9.0,
    "axes.titlesize": 9.5,
    "axes.labelsize": 9.0,
    "legend.fontsize": 8.0,
    "lines.linewidth": 1.2,
    "axes.grid": True,
    "grid.linewidth": 0.4,
    "grid.alpha": 0.5,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.axisbelow": True,
}


@dataclass(frozen=True)
class Line:
    """A signal in a panel, or one of its columns.

    Attributes
    ----------
    signal : str
        Name in the log.
    column : int, optional
        Column to draw; default: all of them.
    label : str or sequence of str
        Label, or one a column; default: X, Y, Z for three columns, numbers for more.
    color : str, optional
        Default: the X, Y, Z colours for three columns, otherwise the next of the cycle.
    style : str
        Line style; "--" is meant for references.
    scale : float
        Factor on the values, such as 1000 from m to mm.
    """

    signal: str
    column: int | None = None
    label: str | Sequence[str] | None = None
    color: str | None = None
    style: str = "-"
    scale: float = 1.0


@dataclass(frozen=True)
class Panel:
    """One panel of a figure.

    Attributes
    ----------
    title : str
    signals : sequence of Line or str
        What is drawn; a plain name stands for all columns of that signal.
    ylabel : str
        Axis label with its unit.
    bounds : mapping from str to float
        Horizontal dashed lines, by label.
    limits : (float, float), optional
        Range of the axis.
    """

    title: str
    signals: Sequence[Line | str]
    ylabel: str
    bounds: dict[str, float] = field(default_factory=dict)
    limits: tuple[float, float] | None = None


@dataclass(frozen=True)
class Shade:
    """Intervals that are shaded in every panel, such as "in contact".

    Attributes
    ----------
    intervals : sequence of (start, end)
        Times (s).
    label : str
        Named once, in the first panel.
    color : str
    """

    intervals: Sequence[tuple[float, float]]
    label: str = ""
    color: str = SHADE


def intervals(time: ArrayLike, mask: ArrayLike) -> list[tuple[float, float]]:
    """Return the intervals (s) in which a (T,) mask is true, each from its first to its last sample."""
    times, inside = np.asarray(time, dtype=float), np.asarray(mask, dtype=bool).reshape(-1)
    edges = np.flatnonzero(np.diff(np.concatenate(([False], inside, [False])).astype(int)))
    return [(float(times[a]), float(times[b - 1])) for a, b in zip(edges[::2], edges[1::2])]


def blank(rows: int = 1, columns: int = 1, title: str = "", size: tuple[float, float] | None = None, *,
          share_time: bool = False) -> tuple[Figure, NDArray[np.object_]]:  # fmt: skip
    """Return an empty figure in the house style and its (rows, columns) axes; `size` is in inches."""
    with rc_context(STYLE):
        figure = Figure(figsize=size or (7.0 * columns, 0.7 + 2.1 * rows), layout="constrained")
        FigureCanvasAgg(figure)
        axes = figure.subplots(rows, columns, squeeze=False, sharex="col" if share_time else False)
        if title:
            figure.suptitle(title, fontsize=10.5, wrap=True)
    return figure, axes


def draw_panel(axes: Axes, log: Log, panel: Panel) -> None:
    """Draw one panel against time."""
    with rc_context(STYLE):
        axes.set_title(panel.title, loc="left")
        axes.set_ylabel(panel.ylabel)
        for item in panel.signals:
            _draw_line(axes, log, Line(item) if isinstance(item, str) else item)
        for label, value in panel.bounds.items():
            axes.axhline(value, color=BOUND, linestyle=(0, (5, 3)), linewidth=0.9, label=label)
        if panel.limits is not None:
            axes.set_ylim(*panel.limits)


def time_panels(log: Log, panels: Sequence[Panel], title: str, shade: Sequence[Shade] | Shade = ()) -> Figure:
    """Return a figure of stacked panels that share the time axis.

    Parameters
    ----------
    log : Log
    panels : sequence of Panel
        From top to bottom.
    title : str
        Title of the figure, with the number of the figure that it repeats.
    shade : Shade or sequence of Shade
        Intervals shaded in every panel.
    """
    figure, axes = blank(len(panels), 1, title, share_time=True)
    shades = [shade] if isinstance(shade, Shade) else list(shade)
    for row, panel in enumerate(panels):
        ax = axes[row, 0]
        for item in shades:
            for i, (start, end) in enumerate(item.intervals):
                label = item.label if row == 0 and i == 0 else None
                ax.axvspan(start, end, color=item.color, alpha=0.25, linewidth=0.0, label=label)
        draw_panel(ax, log, panel)
        legend(ax)
    figure.align_ylabels()
    axes[-1, 0].set_xlabel("time [s]")
    if log.time.size > 1:
        axes[-1, 0].set_xlim(log.time[0], log.time[-1])
    return figure


def legend(axes: Axes) -> None:
    """Put a legend beside the axes if anything there has a label."""
    if axes.get_legend_handles_labels()[1]:
        axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False, fontsize=STYLE["legend.fontsize"])


def _draw_line(axes: Axes, log: Log, line: Line) -> None:
    values = log[line.signal] * line.scale
    total = values.shape[1]
    if line.column is not None and not -total <= line.column < total:
        raise UnknownNameError(f"column of '{line.signal}'", line.column, range(total))
    columns = range(total) if line.column is None else [line.column % total]
    for position, column in enumerate(columns):
        color = line.color
        if color is None and total == 3:
            color = XYZ[column]
        elif color is None:
            color = CYCLE[(column if total > 1 else len(axes.lines)) % len(CYCLE)]
        if line.label is None:
            label = "XYZ"[column] if total == 3 else (f"{column + 1}" if total > 1 else line.signal)
        else:
            label = line.label if isinstance(line.label, str) else line.label[position]
        axes.plot(log.time, values[:, column], line.style, color=color, label=label)
