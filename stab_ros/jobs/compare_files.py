"""Writes a comparison as JSON (the contract's) and as CSV, a row for each frame of each method."""

from __future__ import annotations

from pathlib import Path

from stab_ros.core.text import number
from stab_ros.evaluation.comparison_results import Comparison, Passage
from stab_ros.evaluation.comparison_summary import MEASURES, as_json, frames_of
from stab_ros.evaluation.frame_metrics import FrameMetrics
from stab_ros.jobs.evaluate_files import write_table, write_tree

_COLUMNS = ("method", "frame", "stamp_ns", "status", "error_px", "matches", "inliers", "rmse_px", "sigma_px", "seconds")


def write_json(comparison: Comparison, path: Path) -> None:
    """Raises WorkError where the file cannot be written."""
    write_tree(as_json(comparison), path)


def write_csv(comparison: Comparison, path: Path) -> None:
    """A row for every frame of every method, the raw frames first; empty cells where nothing was measured.

    Raises:
        WorkError: the file cannot be written.
    """
    results = (comparison.raw, *comparison.methods)
    rows = (_cells(result.name, one, row) for result in results for one, row in frames_of(result))
    write_table((*_COLUMNS, *MEASURES), rows, path)


def _cells(name: str, one: Passage, row: FrameMetrics | None) -> list[str]:
    track = one.track
    return [name, str(one.number), str(track.stamp_ns), track.state.value, number(one.error_px), str(track.matches),
            str(track.inliers), number(track.rmse_px), number(track.sigma_px), number(one.seconds),
            *(number(None if row is None else row[metric]) for metric in MEASURES)]
