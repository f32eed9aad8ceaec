"""Settings as frozen dataclasses: the field of a parameter holds its default, its range and its description.

The nodes declare their ROS parameters from these fields; the command line checks `-p name:=value` against them.
"""

from __future__ import annotations

import dataclasses
import difflib
import json
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeAlias

from stab_ros.core.errors import ConfigError

_LARGEST_INTEGER = 2**63 - 1  # of a ROS parameter
_YAML_WORDS = {False: ("off", "no", "false", "n"), True: ("on", "yes", "true", "y")}  # as YAML 1.1 and rcl read them

Value: TypeAlias = bool | int | float | str


@dataclass(frozen=True)
class Range:
    """The values that a field accepts, and its description; the source of the ROS parameter descriptor."""

    doc: str
    low: float | None = None
    high: float | None = None
    choices: tuple[str, ...] = ()


def setting(default: Value, doc: str, low: float | None = None, high: float | None = None,
            choices: tuple[str, ...] = ()) -> Any:
    """A dataclass field with its range (inclusive) or choices."""
    return field(default=default, metadata={"range": Range(doc, low, high, choices)})


def settings_of(config: Any) -> Iterator[tuple[str, Value, Range]]:
    """Name, default and range of every `setting` field of a settings dataclass (or an instance of one)."""
    for item in dataclasses.fields(config):
        if "range" in item.metadata:
            default: Any = item.default
            yield item.name, default, item.metadata["range"]


def checked(name: str, value: object, default: Value, limits: Range) -> Value:
    """`value` converted to the type of `default`, after a check against `limits`.

    A list is the JSON of it where the parameter is text, as polygons are. Where it has choices, a bool is the one that
    YAML reads so: `off` for False.

    Raises:
        ConfigError: wrong type, out of range, or not one of the choices.
    """
    if isinstance(default, float) and type(value) is int and abs(value) <= _LARGEST_INTEGER:
        value = float(value)
    if isinstance(default, str) and type(value) is int and not limits.choices:
        value = str(value)  # `passes:=21` is a whole number to YAML
    if isinstance(default, str) and not isinstance(value, str) and isinstance(value, Sequence) and not limits.choices:
        value = _json_of(value)
    if isinstance(value, bool) and limits.choices:
        value = _choice_of(value, limits.choices)
    if not isinstance(value, type(default)) or type(value) is not type(default):
        must = f"one of {', '.join(limits.choices)}" if limits.choices else f"a {type(default).__name__}"
        raise ConfigError(f"{name}: {value!r} is a {type(value).__name__}, it must be {must}")
    if limits.choices and value not in limits.choices:
        meant = did_you_mean(str(value), limits.choices)
        must = f"{meant} It must" if meant else "it must"
        raise ConfigError(f"{name}: {value!r} is unknown, {must} be one of {', '.join(limits.choices)}")
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        low = float("-inf") if limits.low is None else limits.low
        high = float("inf") if limits.high is None else limits.high
        if not low <= value <= high:  # also refuses NaN
            raise ConfigError(f"{name}: {value!r} is out of range, it must lie in [{low:g}, {high:g}]")
    return value


def _choice_of(value: bool, choices: Iterable[str]) -> str | bool:
    """The one choice that YAML reads as this bool; the bool where there is none, or several."""
    found = [choice for choice in choices if choice in _YAML_WORDS[value]]
    return found[0] if len(found) == 1 else value


def _json_of(values: Sequence[object]) -> str:
    """Strings in a list are JSON themselves, as those of a ROS parameter that holds one polygon in each."""
    if values and all(isinstance(value, str) for value in values):
        return f"[{', '.join(map(str, values))}]"
    return json.dumps(list(values), default=str)


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """A question that names up to three of the known names, the closest to `name` first; "" where none is close."""
    near = difflib.get_close_matches(name, list(known), n=3)
    listed = " or ".join([", ".join(near[:-1]), near[-1]] if len(near) > 1 else near)
    return f"did you mean {listed}?" if near else ""


class Checked:
    """Base class of all settings: validates every field on construction."""

    def __post_init__(self) -> None:
        for name, default, limits in settings_of(self):
            object.__setattr__(self, name, checked(name, getattr(self, name), default, limits))
