"""The directive ``block_diagram``: the picture of one case of a script, drawn by Graphviz."""

import importlib
import shutil

from docutils import nodes
from docutils.parsers.rst import Directive

from saphari_drake.simulation.runner.graph import BlockDiagram


class Blocks(Directive):
    """Draws the Diagram of a script and a case of it."""

    required_arguments = 2

    def run(self) -> list[nodes.Node]:
        """Return the picture, or without Graphviz the command that makes it."""
        script, case = self.arguments
        if shutil.which("dot") is None:
            return [nodes.literal_block(text=f"python diagrams/{script}.py --case {case} --graphviz {script}.svg")]
        experiment = importlib.import_module(script).EXPERIMENT
        svg = BlockDiagram(experiment.build_diagram(experiment.scenario_for(case))).image("svg").decode()
        return [nodes.raw("", f'<div class="blocks">{svg[svg.index("<svg") :]}</div>', format="html")]


def setup(app):
    """Add the directive to Sphinx."""
    app.add_directive("block_diagram", Blocks)
    return {"parallel_read_safe": True}
