"""A comparison as one table for a terminal."""

from __future__ import annotations

from collections.abc import Sequence

from stab_ros.evaluation.comparison_results import Comparison
from stab_ros.evaluation.comparison_summary import as_json
from stab_ros.evaluation.comparison_table import Column, at, columns
from stab_ros.evaluation.summary import Json, or_more
from stab_ros.jobs.compare import RAW

_GAP = "  "


def as_text(comparison: Comparison) -> str:
    """One line for the raw frames and one for each method, then the methods that failed."""
    tree, of = as_json(comparison), columns(comparison.has_truth)
    rows = [["", *(one.head for one in of)], ["", *(one.below for one in of)], _row(RAW, tree["raw"], of)]
    rows += [_row(name, found, of) for name, found in tree["methods"].items() if not found["failure"]]
    failed = [f"{name}: failed: {found['failure']}" for name, found in tree["methods"].items() if found["failure"]]
    return "\n".join([*aligned(rows), *failed])


def aligned(rows: Sequence[Sequence[str]]) -> list[str]:
    """Rows as lines of aligned columns, the first to the left, the others to the right."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return [_GAP.join([row[0].ljust(widths[0]), *(cell.rjust(width) for cell, width in
                                                   zip(row[1:], widths[1:], strict=True))]).rstrip() for row in rows]


def _row(name: str, found: Json, of: Sequence[Column]) -> list[str]:
    return [name, *(_more(found, column) + written(at(found, column.place)) for column in of)]


def _more(found: Json, column: Column) -> str:
    """">" before a displacement that is cut at its range."""
    name, *statistic = column.place
    return ">" if name == "displacement_reference_px" and or_more(found, statistic[0]) else ""


def written(value: float | None) -> str:
    """A number for a table: integers unchanged, small values with two digits, others with three decimals."""
    if value is None:
        return "-"
    if isinstance(value, int):
        return str(value)
    return f"{value:.3f}" if abs(value) >= 0.01 or value == 0 else f"{value:.2g}"
