"""Tables that read well on a terminal and are Markdown at the same time."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Table:
    """rows: cells, as many as `head` has; the first column is left-aligned. note: a line beneath."""

    title: str
    head: Sequence[str]
    rows: Sequence[Sequence[str]]
    note: str = ""

    def text(self) -> str:
        widths = [max(len(cell) for cell in column) for column in zip(self.head, *self.rows, strict=True)]
        rule = [f":{'-' * (width - 1)}" if k == 0 else f"{'-' * (width - 1)}:" for k, width in enumerate(widths)]
        lines = [_line(cells, widths) for cells in (self.head, rule, *self.rows)]
        return "\n".join([f"### {self.title}", "", *lines, *(["", self.note] if self.note else [])])


@dataclass(frozen=True)
class Section:
    """What one part of the benchmark found. data: the same for the JSON file."""

    title: str
    tables: Sequence[Table]
    data: Mapping[str, object]

    def text(self) -> str:
        return "\n\n".join([f"## {self.title}", *(table.text() for table in self.tables)])


def number(value: float, digits: int) -> str:
    """A number; a dash where there is none."""
    return f"{value:.{digits}f}" if math.isfinite(value) else "-"


def verdict(value: float, target: float | None) -> tuple[str, str]:
    """The cells `target` and `met`."""
    if target is None:
        return "", ""
    return f"<= {target:g}", "yes" if value <= target else "NO"


def _line(cells: Sequence[str], widths: Sequence[int]) -> str:
    first, *others = zip(cells, widths, strict=True)
    aligned = [first[0].ljust(first[1]), *(cell.rjust(width) for cell, width in others)]
    return f"| {' | '.join(aligned)} |"
