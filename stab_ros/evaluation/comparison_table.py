"""The columns of a comparison's table, as the terminal and the report show them."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from stab_ros.evaluation.summary import Json


@dataclass(frozen=True)
class Column:
    """Heading of a column, and the unit or statistic below it. place: path of its number in the JSON of a method.

    label: both, where a table without headings names each number.
    """

    head: str
    below: str
    place: tuple[str, ...]
    label: str


_ERROR = (
    Column("error px", "median", ("error_px", "median"), "error, median, px"),
    Column("", "95 %", ("error_px", "p95"), "error, 95 %, px"),
    Column("", "max", ("error_px", "max"), "error, max, px"),
)
_COLUMNS = (
    Column("displaced px", "median", ("displacement_reference_px", "median"), "displaced, median, px"),
    Column("", "95 %", ("displacement_reference_px", "p95"), "displaced, 95 %, px"),
    Column("RMSE", "px", ("rmse_reference_px", "median"), "RMSE, px"),
    Column("RMSD", "levels", ("rmsd_reference", "median"), "RMSD, grey levels"),
    Column("jitter", "px", ("jitter_px",), "jitter, px"),
    Column("drift", "px", ("drift_px",), "drift, px"),
    Column("fit RMSE", "px", ("fit_rmse_px", "median"), "fit RMSE, px"),
    Column("sigma", "px", ("sigma_px", "median"), "sigma, px"),
    Column("time", "s/frame", ("s_per_frame",), "time, s/frame"),
    Column("peak", "MB", ("peak_mb",), "peak memory, MB"),
    Column("matches", "median", ("matches",), "matches"),
    Column("inliers", "median", ("inliers",), "inliers"),
)
_FRAMES = (
    Column("tracked", "frames", ("tracked",), "tracked frames"),
    Column("lost", "frames", ("lost",), "lost frames"),
)


def heads(of: Sequence[Column]) -> list[tuple[str, int]]:
    """The headings and how many columns each spans; a heading also covers the columns after it that have none."""
    starts = [index for index, column in enumerate(of) if column.head]
    return [(of[start].head, end - start) for start, end in itertools.pairwise([*starts, len(of)])]


def columns(has_truth: bool) -> Sequence[Column]:
    """The columns of the table; the error only with a truth."""
    return (*_FRAMES, *(_ERROR if has_truth else ()), *_COLUMNS)


def at(found: Json, place: Sequence[str]) -> Any:
    """The number at `place` of the JSON; None where the raw frames have none."""
    value: Any = found
    for step in place:
        value = value.get(step) if value is not None else None
    return value
