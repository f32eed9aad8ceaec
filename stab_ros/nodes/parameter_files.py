"""Parameters of which nothing applies, as a node was given another name than they are for: in files and words."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path

from stab_ros.core.errors import InputError
from stab_ros.core.text import one_line
from stab_ros.nodes.ros_arguments import values_of
from stab_ros.parameters.file import nodes_named

_TOKENS = {"*": r"/\w+", "**": r"(/\w+)*"}  # of a name, as rcl matches them


def files_for_others(words: Sequence[str], *nodes: str) -> Iterator[str]:
    """A warning for each parameter file of a command line that is for other nodes alone.

    Args:
        words: of the command line.
        nodes: full names of the nodes of the process.
    """
    for name in values_of(words, "--params-file"):
        named = list[str]()
        with suppress(InputError):  # too long for us, not for rcl
            named = nodes_named(Path(name))
        if named and not any(is_for(one, node) for one in named for node in nodes):
            yield (f"{name}: nothing of it applies, it is for {one_line(', '.join(named))[:500]}, and "
                   f"{in_words(nodes)}; let it begin with /**: or with {nodes[0]}:")


def parameters_for_others(words: Sequence[str], *nodes: str) -> Iterator[str]:
    """A warning for each `-p NODE:NAME:=VALUE` of a command line that is for another node; arguments as above."""
    for word in values_of(words, "-p", "--param"):
        node, separator, _ = word.partition(":=")[0].partition(":")
        if separator and not any(is_for(node, one) for one in nodes):
            yield (f"-p {one_line(word)[:500]}: nothing of it applies, it is for /{node}, and {in_words(nodes)}; leave "
                   f"{node}: out{_or_name(nodes)}")


def _or_name(nodes: Sequence[str]) -> str:
    """What else may stand before the name of a parameter: rcl takes the name of a node without a namespace."""
    names = [node.lstrip("/") for node in nodes if node.count("/") == 1]
    return f", or write {' or '.join(names)} instead" if names else ", or name the node in a parameter file"


def in_words(nodes: Sequence[str]) -> str:
    """Which nodes there are, for people."""
    return f"this node is {nodes[0]}" if len(nodes) == 1 else f"the nodes here are {', '.join(nodes)}"


def is_for(pattern: str, node: str) -> bool:
    """Whether parameters under a key of a parameter file apply to a node of this full name."""
    tokens = [_TOKENS.get(token, f"/{re.escape(token)}") for token in pattern.strip("/").split("/")]
    return re.fullmatch("".join(tokens), node) is not None
