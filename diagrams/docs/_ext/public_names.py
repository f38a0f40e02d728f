"""The directive ``public-names``: everything that a package offers by its short name, with its documentation."""

import importlib
import inspect

from docutils.statemachine import StringList
from sphinx.util.docutils import SphinxDirective


class PublicNames(SphinxDirective):
    """Documents the names of ``__all__``, in alphabetical order."""

    required_arguments = 1

    def run(self):
        """Return what autodoc makes of each name."""
        package = importlib.import_module(self.arguments[0])
        lines: list[str] = []
        for name in sorted(package.__all__, key=str.lower):
            value = getattr(package, name)
            if inspect.ismodule(value) or not (inspect.isclass(value) or inspect.isroutine(value)):
                continue
            kind = "autoclass" if inspect.isclass(value) else "autofunction"
            # By its home: what several packages offer is described once.
            lines += [f".. {kind}:: {value.__module__}.{value.__qualname__}", "   :no-index:", ""]
        return self.parse_text_to_nodes(StringList(lines, source=self.arguments[0]))


def setup(app):
    """Add the directive to Sphinx."""
    app.add_directive("public-names", PublicNames)
    return {"parallel_read_safe": True}
