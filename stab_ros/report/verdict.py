"""What the verdict of a report says, as places in the JSON; the page looks the numbers up."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from stab_ros.evaluation.summary import Json
from stab_ros.evaluation.verdict import Answer

_COMPARED = "displacement_reference_px"
_GAINED = 0.8  # of the motion of the raw pictures; above it, nothing was gained


@dataclass(frozen=True)
class Compared:
    """Two streams side by side. first: the one to judge. gained: whether it moves clearly less than the other.

    at_rest: whether both stand still alike, so that there was nothing to gain.
    """

    first: str
    other: str
    gained: bool
    at_rest: bool


def compared(tree: Json) -> Compared | None:
    """The first and the last measured stream, which are stabilised and raw if both exist; None with only one."""
    measured = [name for name, topic in tree["topics"].items() if topic[_COMPARED]["count"]]
    if len(measured) < 2:
        return None
    first, other = measured[0], measured[-1]
    here, there = (tree["topics"][name] for name in (first, other))
    gained = any(a is not None and b is not None and a < _GAINED * b
                 for a, b in ((one["median"], two["median"]) for one, two in
                              ((here[name], there[name]) for name in (_COMPARED, "rmse_reference_px"))))
    still = all(one["verdict"]["answer"] == Answer.STILL.value for one in (here, there))
    return Compared(first, other, gained, still and not gained)


def short_name(name: str) -> str:
    """The last part of a topic's name, or "raw" and "stabilised"."""
    last = name.rstrip("/").removesuffix("/compressed").rpartition("/")[2]
    return {"image_stabilized": "stabilised", "image_raw": "raw"}.get(last, last or name)


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
