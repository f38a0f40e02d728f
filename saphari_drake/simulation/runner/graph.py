"""The block diagram of a scenario as a file."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

from pydrake.systems.framework import Diagram

from saphari_drake.errors import ParameterError
from saphari_drake.simulation.record.files import atomic_path, write_text


def write_graph(build_diagram: Callable[[Any], Diagram] | None, scenario: Any, path: Path) -> None:
    """Write the block diagram of a scenario as Graphviz text, or as an image if the suffix names one."""
    if build_diagram is None:
        raise ParameterError("--graphviz", "this experiment has no block diagram")
    kind = path.suffix.lower().lstrip(".")
    if kind not in ("dot", "gv", "svg", "png", "pdf"):
        raise ParameterError("--graphviz", f"writes .dot, .gv, .svg, .png or .pdf, not '{path.name}'")
    text = build_diagram(scenario).GetGraphvizString()
    if kind in ("dot", "gv"):
        write_text(path, text)
        return
    dot = shutil.which("dot")
    if dot is None:
        raise ParameterError("--graphviz", f"a .{kind} file needs the program 'dot' of Graphviz; .dot works without")
    with atomic_path(path) as temporary:
        subprocess.run([dot, f"-T{kind}", "-o", str(temporary)], input=text.encode(), check=True)
