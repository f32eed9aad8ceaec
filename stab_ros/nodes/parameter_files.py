"""Parameter files of which nothing applies, as a node was given another name than they are for."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from contextlib import suppress
from itertools import pairwise
from pathlib import Path

from stab_ros.core.errors import InputError
from stab_ros.core.text import one_line
from stab_ros.parameters.file import nodes_named

_TOKENS = {"*": r"/\w+", "**": r"(/\w+)*"}  # of a name, as rcl matches them


def files_for_others(words: Sequence[str], *nodes: str) -> Iterator[str]:
    """A warning for each parameter file of a command line that is for other nodes alone.

    Args:
        words: of the command line.
        nodes: full names of the nodes of the process.
    """
    ours = f"this node is {nodes[0]}" if len(nodes) == 1 else f"the nodes here are {', '.join(nodes)}"
    for name in [word for before, word in pairwise(words) if before == "--params-file"]:
        named = list[str]()
        with suppress(InputError):  # too long for us, not for rcl
            named = nodes_named(Path(name))
        if named and not any(is_for(one, node) for one in named for node in nodes):
            yield (f"{name}: nothing of it applies, it is for {one_line(', '.join(named))[:500]}, and {ours}; let it "
                   f"begin with /**: or with {nodes[0]}:")


def is_for(pattern: str, node: str) -> bool:
    """Whether parameters under a key of a parameter file apply to a node of this full name."""
    tokens = [_TOKENS.get(token, f"/{re.escape(token)}") for token in pattern.strip("/").split("/")]
    return re.fullmatch("".join(tokens), node) is not None
