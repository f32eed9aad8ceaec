"""The methods named in the headline of a comparison; the page looks up their numbers."""

from __future__ import annotations

from collections.abc import Sequence

from stab_ros.evaluation.comparison_table import at
from stab_ros.evaluation.summary import Json

_DISPLACED = "displacement_reference_px"


def best(tree: Json, *place: str) -> str | None:
    """The method with the smallest number at `place` among those with the fewest lost frames; None without any."""
    known = [(int(one["lost"]), float(value), str(name)) for name, one in tree["methods"].items()
             if (value := at(one, place)) is not None]
    return min(known)[2] if known else None


def alike(tree: Json, first: str) -> Sequence[str]:
    """The other methods with as few lost frames whose displacement has a box (quartiles) that overlaps that of `first`.

    They cannot be told apart from it.
    """
    methods = tree["methods"]
    box, lost = methods[first][_DISPLACED], methods[first]["lost"]
    return [name for name, one in methods.items() if name != first and one["lost"] == lost and _overlap(one, box)]


def _overlap(one: Json, box: Json) -> bool:
    low, high = one[_DISPLACED].get("q1"), one[_DISPLACED].get("q3")
    return low is not None and bool(low <= box["q3"] and high >= box["q1"])


def with_lost(tree: Json) -> Sequence[str]:
    """The methods with lost frames, the most first."""
    names = [name for name, one in tree["methods"].items() if one["lost"]]
    return sorted(names, key=lambda name: -int(tree["methods"][name]["lost"]))


def failed(tree: Json) -> Sequence[str]:
    """The methods that failed."""
    return [name for name, one in tree["methods"].items() if one["failure"]]
