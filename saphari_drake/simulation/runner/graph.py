"""The block diagram of a scenario, drawn by Graphviz."""

from __future__ import annotations

import shutil
import subprocess
from collections import defaultdict
from collections.abc import Callable
from html import escape
from pathlib import Path
from typing import Any

from pydrake.systems.framework import Diagram, System
from pydrake.systems.primitives import VectorLogSink

from saphari_drake.errors import ParameterError
from saphari_drake.simulation.record.files import atomic_path, write_text
from saphari_drake.simulation.record.recorder import ValueToVector

STYLE = (
    "rankdir=TB; ranksep=0.35; nodesep=0.15",
    'node [shape=box, style="rounded,filled", fillcolor="#eef3f8", fontname="Helvetica", fontsize=11, height=0.3]',
    'edge [fontname="Helvetica", fontsize=8, color="#555555", arrowsize=0.6]',
)


class BlockDiagram:
    """The systems of a diagram and what connects them; a notebook shows it as a picture.

    A box a system, an arrow from one to another with the names of the ports that give; what only records
    (`VectorLogSink`, `ValueToVector`) is left out.

    Parameters
    ----------
    diagram : Diagram
        Drawn one level deep.

    Attributes
    ----------
    text : str
        For Graphviz.
    """

    def __init__(self, diagram: Diagram) -> None:
        drawn = [system for system in diagram.GetSystems() if not isinstance(system, VectorLogSink | ValueToVector)]
        boxes = [f'"{system.get_name()}" [label=<{_label(system)}>]' for system in drawn]
        names, wires = {system.get_name() for system in drawn}, defaultdict(set)
        for (taker, _), (giver, port) in diagram.connection_map().items():
            if taker.get_name() in names:
                wires[giver.get_name(), taker.get_name()].add(giver.get_output_port(port).get_name())
        arrows = [f'"{a}" -> "{b}" [label="{_lines(sorted(ports))}"]' for (a, b), ports in sorted(wires.items())]
        self.text = "\n".join(["digraph {", *STYLE, *boxes, *arrows, "}\n"])

    def image(self, kind: str) -> bytes:
        """Return the picture as `kind`, a format of Graphviz.

        Raises
        ------
        ParameterError
            If Graphviz is not installed.
        """
        dot = shutil.which("dot")
        if dot is None:
            raise ParameterError("graphviz", f"a picture (.{kind}) needs the program 'dot' of Graphviz; .dot does not")
        return subprocess.run([dot, f"-T{kind}"], input=self.text.encode(), check=True, stdout=subprocess.PIPE).stdout

    def _repr_svg_(self) -> str | None:
        return self.image("svg").decode() if shutil.which("dot") else None


def _label(system: System) -> str:
    kind = type(system).__name__.rstrip("_").split("_")[0]
    return f"<B>{escape(system.get_name())}</B><BR/>{kind}"


def _lines(names: list[str]) -> str:
    return r"\n".join(names)


def write_graph(build_diagram: Callable[[Any], Diagram] | None, scenario: Any, path: Path) -> None:
    """Write the block diagram of a scenario as Graphviz text, or as an image if the suffix names one."""
    if build_diagram is None:
        raise ParameterError("--graphviz", "this experiment has no block diagram")
    kind = path.suffix.lower().lstrip(".")
    if kind not in ("dot", "gv", "svg", "png", "pdf"):
        raise ParameterError("--graphviz", f"writes .dot, .gv, .svg, .png or .pdf, not '{path.name}'")
    drawn = BlockDiagram(build_diagram(scenario))
    if kind in ("dot", "gv"):
        write_text(path, drawn.text)
        return
    image = drawn.image(kind)
    with atomic_path(path) as temporary:
        temporary.write_bytes(image)
