"""What the headline says, as places in the JSON; the page looks the numbers up."""

from __future__ import annotations

from typing import Any

from stab_ros.evaluation.summary import Json

_COMPARED = "displacement_reference_px"


def compared(tree: Json) -> tuple[str, str] | None:
    """The first and the last stream, raw and stabilised where there are such; None with only one to tell about."""
    measured = [name for name, topic in tree["topics"].items() if topic[_COMPARED]["count"]]
    return (measured[0], measured[-1]) if len(measured) > 1 else None


def extreme_frame(topic: Json, name: str) -> int | None:
    """The row of `per_frame` with the largest size of a metric; None where no frame has it."""
    known = [(abs(value), index) for index, row in enumerate(topic["per_frame"]) if (value := row[name]) is not None]
    return max(known, key=lambda one: one[0])[1] if known else None


def brightest_frame(topic: Json) -> int | None:
    """The row whose brightness changed most, if by as much as is to be told."""
    index = extreme_frame(topic, "brightness_change")
    if index is None:
        return None
    change: Any = topic["per_frame"][index]["brightness_change"]
    return index if abs(change) >= topic["settings"]["brightness_warn"] else None
