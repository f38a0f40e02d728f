"""The directive ``pydrake_system``: the ports of a system, given as YAML, drawn as a block."""

from html import escape

import yaml
from docutils import nodes
from docutils.parsers.rst import Directive


class PydrakeSystem(Directive):
    """Draws one block."""

    has_content = True

    def run(self) -> list[nodes.Node]:
        """Return the block as HTML."""
        ports = yaml.safe_load("\n".join(self.content))
        inputs, outputs = ports.get("input_ports", []), ports.get("output_ports", [])
        left = "".join(f"<div>{escape(str(name))} →</div>" for name in inputs)
        right = "".join(f"<div>→ {escape(str(name))}</div>" for name in outputs)
        block = f'<div class="system-name">{escape(ports["name"])}</div>'
        columns = f'<div class="system-ports system-in">{left}</div>{block}<div class="system-ports">{right}</div>'
        return [nodes.raw("", f'<div class="system">{columns}</div>', format="html")]


def setup(app):
    """Add the directive to Sphinx."""
    app.add_directive("pydrake_system", PydrakeSystem)
    return {"parallel_read_safe": True}
