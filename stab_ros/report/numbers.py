"""Numbers in the text of a report: each is a number of the JSON, rounded, with a pointer to its place there."""

from __future__ import annotations

from typing import Any

from markupsafe import Markup, escape

from stab_ros.evaluation.frame_metrics import COUNTS
from stab_ros.evaluation.summary import Json

NOTHING = "-"


class Numbers:
    """Looks numbers up in the JSON of an evaluation."""

    def __init__(self, tree: Json) -> None:
        self._tree = tree

    def __call__(self, *path: str | int) -> Markup:
        """The number at `path`, as an element that names its place as a JSON pointer (RFC 6901)."""
        pointer = "".join("/" + str(step).replace("~", "~0").replace("/", "~1") for step in path)
        return Markup('<span class="number" data-pointer="{}">{}</span>').format(pointer, shown(self._at(path), *path))

    def _at(self, path: tuple[str | int, ...]) -> Any:
        value: Any = self._tree
        for step in path:
            value = value[step]
        return value


def shown(value: Any, *path: str | int) -> str:
    """A number as text: three decimals, two significant digits if small, none of a count; a dash for None.

    path: its place in the JSON.
    """
    if value is None:
        return NOTHING
    if isinstance(value, bool | str):
        return str(escape(value))
    if COUNTS.intersection(map(str, path)):
        return f"{value:.0f}"
    if isinstance(value, int) or float(value).is_integer():
        return str(int(value))
    return f"{value:.3f}" if abs(value) >= 0.01 else f"{value:.2g}"
