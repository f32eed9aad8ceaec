"""The methods named in the headline of a comparison; the page looks up their numbers."""

from __future__ import annotations

from collections.abc import Sequence

from stab_ros.evaluation.comparison_table import at
from stab_ros.evaluation.summary import Json


def best(tree: Json, *place: str) -> str | None:
    """The method with the smallest number at `place` among those with the fewest lost frames; None without any."""
    known = [(int(one["lost"]), float(value), str(name)) for name, one in tree["methods"].items()
             if (value := at(one, place)) is not None]
    return min(known)[2] if known else None


def with_lost(tree: Json) -> Sequence[str]:
    """The methods with lost frames, the most first."""
    names = [name for name, one in tree["methods"].items() if one["lost"]]
    return sorted(names, key=lambda name: -int(tree["methods"][name]["lost"]))


def failed(tree: Json) -> Sequence[str]:
    """The methods that failed."""
    return [name for name, one in tree["methods"].items() if one["failure"]]
