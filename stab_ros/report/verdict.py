"""The numbers of the headline, as places in the JSON; the page looks them up."""

from __future__ import annotations

from typing import Any

from stab_ros.evaluation.summary import Json

_COMPARED = "displacement_reference_px"


def compared(tree: Json) -> tuple[str, str] | None:
    """The first and the last measured stream, which are raw and stabilised if both exist; None with only one."""
    measured = [name for name, topic in tree["topics"].items() if topic[_COMPARED]["count"]]
    return (measured[0], measured[-1]) if len(measured) > 1 else None


def extreme_frame(topic: Json, name: str) -> int | None:
    """The row of `per_frame` with the largest absolute value of a metric; None if no frame has it."""
    known = [(abs(value), index) for index, row in enumerate(topic["per_frame"]) if (value := row[name]) is not None]
    return max(known, key=lambda one: one[0])[1] if known else None


def brightest_frame(topic: Json) -> int | None:
    """The row with the largest change of brightness, if it reaches the warning threshold."""
    index = extreme_frame(topic, "brightness_change")
    if index is None:
        return None
    change: Any = topic["per_frame"][index]["brightness_change"]
    return index if abs(change) >= topic["settings"]["brightness_warn"] else None
