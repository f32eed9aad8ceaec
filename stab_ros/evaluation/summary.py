"""An evaluation summarised as a JSON tree (the contract's), and the statistics in it."""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import Any, TypeAlias

import numpy as np

from stab_ros.core.types import FloatArray
from stab_ros.evaluation.findings import Finding, Level, findings
from stab_ros.evaluation.frame_metrics import POINT_METRICS, UNITS, FrameMetrics, Outcome
from stab_ros.evaluation.results import Evaluation, TopicEvaluation
from stab_ros.evaluation.verdict import verdict_of
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
    found["points_left_out"] = _left_out(topic)
    found["hot_pixels"] = topic.hot_pixels
    found["remarks"] = list(topic.remarks)
    found["verdict"] = verdict_of(topic).as_json()
    found["findings"] = _findings(topic)
    found["per_frame"] = [_frame(row) for row in topic.rows]
    return found


def summary_json(summary: Summary | None) -> Json:
    """The statistics of a metric; null without values."""
    if summary is None:
        return {"median": None, "p95": None, "max": None, "count": 0}
    return {"median": summary.median, "p95": summary.p95, "max": summary.max, "count": summary.count,
            "mean": summary.mean, "q1": summary.q1, "q3": summary.q3, "whisker_low": summary.whisker_low,
            "whisker_high": summary.whisker_high, "outliers": len(summary.outliers)}


def or_more(found: Json, statistic: str) -> bool:
    """Whether a statistic of the displacement against the reference, of a stream or method, is cut at its range."""
    beyond = found["points_beyond_range"].get(statistic)
    return beyond is not None and bool(beyond > 0)


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
            "static": bool(topic.static[index]),
            "fixed_to_camera": bool(len(topic.camera_fixed) and topic.camera_fixed[index]), **medians}


def _left_out(topic: TopicEvaluation) -> Json:
    """How many points are in no mean, by reason."""
    fixed = int((~topic.static & topic.camera_fixed).sum()) if len(topic.camera_fixed) else 0
    return {"fixed_to_camera": fixed, "moving": int((~topic.static).sum()) - fixed}


def unrest_px(topic: TopicEvaluation) -> tuple[float | None, float | None]:
    """Jitter and drift, px: RMS of the shift above and below 1 Hz; None with too few measured frames."""
    u, v = shifts_px(topic)
    if np.isfinite(u).sum() < 2 or not topic.fps > 0:
        return None, None
    jitter_px, drift_px = jitter_and_drift(u, v, topic.fps)
    return _finite(jitter_px), _finite(drift_px)


def shifts_px(topic: TopicEvaluation) -> tuple[FloatArray, FloatArray]:
    """Shifts u and v, (T,) each, of all frames but the reference, evenly spaced in time; NaN where not measured."""
    u, v = (np.array([math.nan if row[name] is None else row[name] for row in after_reference(topic)], float)
            for name in ("shift_u_px", "shift_v_px"))
    return u, v


def after_reference(topic: TopicEvaluation) -> list[FrameMetrics]:
    """All frames except the reference, measured or not."""
    return [row for row in topic.rows if row.outcome is not Outcome.REFERENCE]


def findings_of(topic: TopicEvaluation) -> list[Finding]:
    """The problems of all frames, the most severe first."""
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
