"""What an evaluation found, as JSON (the contract's) and as CSV, a row for each frame."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Iterable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from stab_ros.core.errors import WorkError
from stab_ros.core.text import number
from stab_ros.core.types import FloatArray
from stab_ros.evaluation.findings import Finding, Level, findings
from stab_ros.evaluation.frame_metrics import POINT_METRICS, UNITS, FrameMetrics, Outcome
from stab_ros.jobs.evaluate import Evaluation, TopicEvaluation
from stab_ros.metrics.spectra import jitter_and_drift
from stab_ros.metrics.statistics import Summary
from stab_ros.metrics.velocity_field import RegionVelocity

Json: TypeAlias = dict[str, Any]
_WORST = 5  # findings that are quoted


def as_json(evaluation: Evaluation) -> Json:
    """`evaluate --json`: metrics by topic with median, p95, max and count, `svf`, `points`, and more."""
    return {"frames": evaluation.frames, "source": evaluation.source.name, "warnings": list(evaluation.warnings),
            "topics": {topic.topic: topic_json(topic) for topic in evaluation.topics}}


def topic_json(topic: TopicEvaluation) -> Json:
    """One stream."""
    found: Json = {name: summary_json(topic.summary(name)) for name in UNITS}
    found["svf"] = [_region(region) for region in topic.field.regions] if topic.field else []
    found["points"] = [_point(topic, index) for index in range(len(topic.points))]
    found["frames"] = len(topic.rows)
    for outcome in Outcome:
        found[f"frames_{outcome.value.lower()}"] = topic.count(outcome)
    found["fps"] = topic.fps
    found["gsd_m"] = topic.config.gsd_m or None
    found["size_px"] = list(topic.reference.size)
    found["settings"] = asdict(topic.config)
    found["jitter_px"], found["drift_px"] = unrest_px(topic)
    found["findings"] = _findings(topic)
    found["per_frame"] = [_frame(row) for row in topic.rows]
    return found


def summary_json(summary: Summary | None) -> Json:
    """Statistics of a metric; None where there are no values."""
    if summary is None:
        return {"median": None, "p95": None, "max": None, "count": 0}
    return {"median": summary.median, "p95": summary.p95, "max": summary.max, "count": summary.count,
            "mean": summary.mean, "q1": summary.q1, "q3": summary.q3, "whisker_low": summary.whisker_low,
            "whisker_high": summary.whisker_high, "outliers": len(summary.outliers)}


def _region(region: RegionVelocity) -> Json:
    return {"region": region.region, "x_px": region.x_px, "y_px": region.y_px, "u_px": _finite(region.u_px),
            "v_px": _finite(region.v_px), "magnitude_px": _finite(region.magnitude_px), "vectors": region.vectors}


def _point(topic: TopicEvaluation, index: int) -> Json:
    point = topic.points[index]
    fit = point.calibration
    medians = {name: float(np.median(values)) if (values := topic.point_series(name, index)) else None
               for name in POINT_METRICS}
    return {"name": point.name, "x": point.x_px, "y": point.y_px, "a": fit.a, "b": fit.b, "r2": fit.r2,
            "by_direction": list(map(list, fit.by_direction)), "range_px": fit.range_px, "window_px": fit.window_px,
            "static": bool(topic.static[index]), **medians}


def unrest_px(topic: TopicEvaluation) -> tuple[float | None, float | None]:
    """Jitter and drift, px: RMS of the shift above and below 1 Hz; None where too few frames tell."""
    u, v = shifts_px(topic)
    if np.isfinite(u).sum() < 2 or not topic.fps > 0:
        return None, None
    jitter_px, drift_px = jitter_and_drift(u, v, topic.fps)
    return _finite(jitter_px), _finite(drift_px)


def shifts_px(topic: TopicEvaluation) -> tuple[FloatArray, FloatArray]:
    """Shifts u and v, (T,) each, of the frames after the reference, evenly spaced in time; NaN: not measured."""
    u, v = (np.array([math.nan if row[name] is None else row[name] for row in after_reference(topic)], float)
            for name in ("shift_u_px", "shift_v_px"))
    return u, v


def after_reference(topic: TopicEvaluation) -> list[FrameMetrics]:
    """All frames but the reference, measured or not."""
    return [row for row in topic.rows if row.outcome is not Outcome.REFERENCE]


def findings_of(topic: TopicEvaluation) -> list[Finding]:
    """Those of all frames, the worst first."""
    found = [one for row in topic.rows for one in findings(row, topic.config)]
    return sorted(found, key=lambda one: -one.level)


def _findings(topic: TopicEvaluation) -> Json:
    found = findings_of(topic)
    return {"warn": sum(one.level == Level.WARN for one in found),
            "error": sum(one.level == Level.ERROR for one in found), "worst": [one.text for one in found[:_WORST]]}


def _frame(row: FrameMetrics) -> Json:
    return {"frame": row.frame, "stamp_ns": row.stamp_ns, "outcome": row.outcome.value,
            **{name: row[name] for name in UNITS}}


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


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
