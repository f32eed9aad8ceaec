"""What a comparison found, as one table to read on a terminal."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from stab_ros.jobs.compare import RAW, Comparison
from stab_ros.jobs.compare_files import as_json
from stab_ros.jobs.evaluate_files import Json

_GAP = "  "


@dataclass(frozen=True)
class Column:
    """head, and the unit or statistic below it. place: where its number lies in the JSON of a method."""

    head: str
    below: str
    place: tuple[str, ...]


_ERROR = (Column("error px", "median", ("error_px", "median")), Column("", "95 %", ("error_px", "p95")),
          Column("", "max", ("error_px", "max")))
_COLUMNS = (
    Column("displaced px", "median", ("displacement_reference_px", "median")),
    Column("", "95 %", ("displacement_reference_px", "p95")),
    Column("RMSE", "px", ("rmse_reference_px", "median")),
    Column("RMSD", "levels", ("rmsd_reference", "median")),
    Column("jitter", "px", ("jitter_px",)),
    Column("drift", "px", ("drift_px",)),
    Column("fit RMSE", "px", ("fit_rmse_px", "median")),
    Column("sigma", "px", ("sigma_px", "median")),
    Column("time", "s/frame", ("s_per_frame",)),
    Column("peak", "MB", ("peak_mb",)),
    Column("matches", "median", ("matches",)),
    Column("inliers", "median", ("inliers",)),
)
_FRAMES = (Column("tracked", "frames", ("tracked",)), Column("lost", "frames", ("lost",)))


def heads(of: Sequence[Column]) -> list[tuple[str, int]]:
    """The heads, and over how many columns each reaches: those after it without one are its own."""
    starts = [index for index, column in enumerate(of) if column.head]
    return [(of[start].head, end - start) for start, end in itertools.pairwise([*starts, len(of)])]


def columns(has_truth: bool) -> Sequence[Column]:
    """Of the table; the error only where the truth is known."""
    return (*_FRAMES, *(_ERROR if has_truth else ()), *_COLUMNS)


def as_text(comparison: Comparison) -> str:
    """A line for the raw frames and one for each method; below them what failed."""
    tree, of = as_json(comparison), columns(comparison.has_truth)
    rows = [["", *(one.head for one in of)], ["", *(one.below for one in of)], _row(RAW, tree["raw"], of)]
    rows += [_row(name, found, of) for name, found in tree["methods"].items() if not found["failure"]]
    failed = [f"{name}: failed: {found['failure']}" for name, found in tree["methods"].items() if found["failure"]]
    return "\n".join([*aligned(rows), *failed])


def aligned(rows: Sequence[Sequence[str]]) -> list[str]:
    """Cells below each other, the first of a row to the left, the others to the right."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return [_GAP.join([row[0].ljust(widths[0]), *(cell.rjust(width) for cell, width in
                                                   zip(row[1:], widths[1:], strict=True))]).rstrip() for row in rows]


def _row(name: str, found: Json, of: Sequence[Column]) -> list[str]:
    return [name, *(written(at(found, column.place)) for column in of)]


def at(found: Json, place: Sequence[str]) -> Any:
    """The number at `place`; None where the raw frames have none."""
    value: Any = found
    for step in place:
        value = value.get(step) if value is not None else None
    return value


def written(value: float | None) -> str:
    """A number for a table: whole ones as they are, others to three decimals, or two digits where that hides them."""
    if value is None:
        return "-"
    if isinstance(value, int):
        return str(value)
    return f"{value:.3f}" if abs(value) >= 0.01 or value == 0 else f"{value:.2g}"
