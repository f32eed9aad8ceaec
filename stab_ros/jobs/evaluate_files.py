"""Writes an evaluation as JSON (the contract's) and as CSV, a row for each frame."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from stab_ros.core.errors import WorkError
from stab_ros.core.text import number
from stab_ros.evaluation.frame_metrics import POINT_METRICS, UNITS, FrameMetrics
from stab_ros.evaluation.results import Evaluation, TopicEvaluation
from stab_ros.evaluation.summary import Json, as_json


def write_json(evaluation: Evaluation, path: Path) -> None:
    """Raises WorkError where the file cannot be written."""
    write_tree(as_json(evaluation), path)


def write_tree(tree: Json, path: Path) -> None:
    """Raises WorkError where the file cannot be written."""
    try:
        path.write_text(json.dumps(tree, indent=1, allow_nan=False) + "\n", encoding="utf-8")
    except OSError as error:
        raise WorkError(f"{path}: {error.strerror}") from error


def write_csv(evaluation: Evaluation, path: Path) -> None:
    """A row for every frame of every stream; empty cells where nothing was measured.

    Raises:
        WorkError: the file cannot be written.
    """
    topics = evaluation.topics
    write_table(_columns(topics), (_cells(topic, row, topics) for topic in topics for row in topic.rows), path)


def write_table(columns: Sequence[str], rows: Iterable[Sequence[str]], path: Path) -> None:
    """Raises WorkError where the file cannot be written."""
    try:
        with path.open("w", encoding="utf-8", newline="") as file:
            table = csv.writer(file, lineterminator="\n")
            table.writerow(columns)
            table.writerows(rows)
    except OSError as error:
        raise WorkError(f"{path}: {error.strerror}") from error


def _columns(topics: Sequence[TopicEvaluation]) -> list[str]:
    return ["topic", "frame", "stamp_ns", "outcome", *UNITS,
            *(f"{name}.{point}" for name in POINT_METRICS for point in _point_names(topics))]


def _point_names(topics: Sequence[TopicEvaluation]) -> list[str]:
    return list(dict.fromkeys(point.name for topic in topics for point in topic.points))


def _cells(topic: TopicEvaluation, row: FrameMetrics, topics: Sequence[TopicEvaluation]) -> list[str]:
    cells = [topic.topic, str(row.frame), str(row.stamp_ns), row.outcome.value, *(number(row[name]) for name in UNITS)]
    for name in POINT_METRICS:
        values = row.points.get(name, np.empty(0)).tolist()
        known = {point.name: value for point, value in zip(topic.points, values, strict=False) if math.isfinite(value)}
        cells += [number(known.get(point)) for point in _point_names(topics)]
    return cells
