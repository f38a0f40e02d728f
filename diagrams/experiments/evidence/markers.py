"""Generated parts of a text, between `<!-- results:NAME -->` and `<!-- /results -->`."""

from __future__ import annotations

import re
from collections.abc import Mapping

from saphari_drake.errors import ParameterError

BLOCK = re.compile(r"<!-- results:(\w+) -->\n(.*?)<!-- /results -->", re.DOTALL)


def with_blocks(text: str, blocks: Mapping[str, str]) -> str:
    """Return the text with its blocks replaced; both must have the same ones."""
    names = [match[1] for match in BLOCK.finditer(text)]
    wrong = sorted(set(names) ^ set(blocks)) or sorted({name for name in names if names.count(name) > 1})
    if wrong:
        raise ParameterError("README", f"each generated part has one pair of markers, results:NAME; not {wrong}")
    return BLOCK.sub(lambda match: f"<!-- results:{match[1]} -->\n\n{blocks[match[1]]}\n\n<!-- /results -->", text)


def without_blocks(text: str) -> str:
    """Return the text without its generated parts."""
    return BLOCK.sub("", text)
