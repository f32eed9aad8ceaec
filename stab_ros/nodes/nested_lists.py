"""Lists in ROS arguments that rcl cannot hold, such as polygons: passed on to it as text.

Of a list of lists, rcl keeps the last row (`-p`), or refuses it ("Sequences cannot be key", in a file); whole numbers
beside others it refuses. As strings of JSON they reach the parameters whole, which read them.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import yaml

from stab_ros.core.errors import InputError

_PARAMETER, _FILE = ("-p", "--param"), "--params-file"
_LIMIT = 2**20  # characters that are looked through; rcl gets longer ones as they are
_NUMBERS = {"tag:yaml.org,2002:int", "tag:yaml.org,2002:float"}


def with_lists_as_text(words: Sequence[str], folder: Callable[[], Path]) -> list[str]:
    """The words of a command line, with all such lists in parameters and in parameter files as text.

    Args:
        words: of the command line.
        folder: makes a new folder, for a file that holds such lists to be written anew; it may go once rcl has read it.

    Raises:
        InputError: the file cannot be written.
    """
    told, of_ros, before = list[str](), False, ""
    for word in words:
        of_ros = word == "--ros-args" or (of_ros and word != "--")
        told.append(_told(before, word, folder) if of_ros else word)
        before = word
    return told


def _told(before: str, word: str, folder: Callable[[], Path]) -> str:
    """A word behind another one."""
    if before in _PARAMETER:
        name, separator, value = word.partition(":=")
        return f"{name}{separator}{lists_as_text(value)}"
    return _rewritten(word, folder) if before == _FILE else word


def lists_as_text(text: str) -> str:
    """YAML in which lists that rcl cannot hold are strings of JSON; what is no YAML as it is, for rcl to refuse."""
    try:
        if len(text) > _LIMIT or any(isinstance(event, yaml.AliasEvent) for event in yaml.parse(text)):
            return text  # rcl has no aliases
        root = yaml.compose(text, yaml.SafeLoader)
        found = [] if root is None else list(_unholdable(root))
        for node in reversed(found):
            text = f"{text[:node.start_mark.index]}{_quoted(node)}{text[_end_of(node):]}"
    except (yaml.YAMLError, ValueError, RecursionError):
        return text
    return text


def _unholdable(node: yaml.Node) -> Iterator[yaml.SequenceNode]:
    """The outermost lists that rcl cannot hold, in the order of the text."""
    if isinstance(node, yaml.SequenceNode):
        tags = {item.tag for item in node.value}
        if tags == _NUMBERS or not all(isinstance(item, yaml.ScalarNode) for item in node.value):
            yield node
    elif isinstance(node, yaml.MappingNode):
        for _, value in node.value:
            yield from _unholdable(value)


def _quoted(node: yaml.SequenceNode) -> str:
    text = json.dumps(yaml.SafeLoader("").construct_object(node, deep=True), default=str).replace("'", "''")
    return f"'{text}'" if node.flow_style else f" '{text}'"  # whose dashes may stand below the first letter of the key


def _end_of(node: yaml.Node) -> int:
    """Where the text of a node ends; that of a list in lines of its own with its last item, not the next key."""
    if isinstance(node, yaml.SequenceNode) and not node.flow_style and node.value:
        return _end_of(node.value[-1])
    return int(node.end_mark.index)


def _rewritten(name: str, folder: Callable[[], Path]) -> str:
    """The name of a file with the same parameters that rcl can hold: the same one where nothing is to be changed."""
    try:
        text = Path(name).read_text(encoding="utf-8")
    except (OSError, ValueError):  # rcl says what is wrong with it
        return name
    told = lists_as_text(text)
    if told == text:
        return name
    try:
        copy = folder() / Path(name).name
        copy.write_text(told, encoding="utf-8")
    except OSError as error:
        raise InputError(f"{name}: its lists of lists cannot be passed on to ROS, as no temporary file can be written "
                         f"({error.strerror}); write them in quotes, as '[[[x, y], ...], ...]'") from error
    return str(copy)
