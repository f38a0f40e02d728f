"""Generated parts of a text, between `<!-- results:NAME -->` and `<!-- /results -->`."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

from saphari_drake.errors import ParameterError

BLOCK = re.compile(r"<!-- results:(\w+) -->\n(.*?)<!-- /results -->", re.DOTALL)


def with_blocks(texts: Sequence[str], blocks: Mapping[str, str]) -> list[str]:
    """Return texts with their blocks replaced; each block is in one of them."""
    names = [match[1] for text in texts for match in BLOCK.finditer(text)]
    wrong = sorted(set(names) ^ set(blocks)) or sorted({name for name in names if names.count(name) > 1})
    if wrong:
        raise ParameterError("README", f"each generated part has one pair of markers, results:NAME; not {wrong}")

    def made(match: re.Match[str]) -> str:
        return f"<!-- results:{match[1]} -->\n\n{blocks[match[1]]}\n\n<!-- /results -->"

    return [BLOCK.sub(made, text) for text in texts]


def without_blocks(text: str) -> str:
    """Return the text without its generated parts."""
    return BLOCK.sub("", text)
