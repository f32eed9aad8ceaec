"""YAML files of users."""

from __future__ import annotations

from pathlib import Path

import yaml

from stab_ros.core.errors import InputError
from stab_ros.core.text import one_line

_LIMIT = 2**17  # characters of a file; PyYAML reads 100,000 a second


class _Loader(yaml.SafeLoader):
    """YAML without aliases, as in ROS: a few lines of aliases can expand to billions of values."""

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        if self.check_event(yaml.AliasEvent):
            raise yaml.YAMLError(f"line {self.line + 1}: aliases are not supported")
        return super().compose_node(parent, index)


def _integer(loader: yaml.SafeLoader, node: yaml.ScalarNode) -> int:
    """An integer of 64 bits; larger ones are slow to print."""
    value: int = loader.construct_yaml_int(node)
    if not -(2**63) <= value < 2**63:
        raise yaml.YAMLError(f"line {node.start_mark.line + 1}: a number does not fit 64 bits")
    return value


_Loader.add_constructor("tag:yaml.org,2002:int", _integer)


def read_yaml(path: Path) -> object:
    """The content of a file.

    Raises:
        InputError: it is missing or too long, or no YAML.
    """
    try:
        with path.open(encoding="utf-8") as file:
            text = file.read(_LIMIT + 1)
        if len(text) > _LIMIT:
            raise ValueError(f"more than {_LIMIT} characters")
        return yaml.load(text, _Loader)
    except (OSError, ValueError, LookupError, AttributeError, TypeError, OverflowError, RecursionError,
            yaml.YAMLError) as error:  # a value that contradicts its tag raises almost any of these
        raise InputError(f"{path}: not a readable YAML file ({one_line(error)[:500]})") from error
