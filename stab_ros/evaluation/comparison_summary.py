"""A comparison summarised as a JSON tree (the contract's), and the statistics in it."""

from __future__ import annotations

import statistics
from collections.abc import Sequence

from stab_ros.core.types import Track
from stab_ros.evaluation.comparison_results import Comparison, MethodResult, Passage
from stab_ros.evaluation.frame_metrics import FrameMetrics
from stab_ros.evaluation.summary import Json, summary_json, unrest_px
from stab_ros.metrics.statistics import summarize

# metrics of the evaluator that a comparison reports
MEASURES = ("displacement_reference_px", "displacement_previous_px", "rmse_reference_px", "rmse_previous_px",
            "rmsd_reference", "rmsd_previous", "checkpoints", "points_used", "points_beyond_range")


def as_json(comparison: Comparison) -> Json:
    """`compare --json`: for each method the tracked frames, error against the truth, time, memory and metrics."""
    return {"frames": comparison.frames, "source": comparison.source.name, "truth": comparison.has_truth,
            "warnings": list(comparison.warnings), "raw": _judged(comparison.raw, comparison.has_truth),
            "methods": {one.name: method_json(one, comparison.has_truth) for one in comparison.methods}}


def method_json(result: MethodResult, has_truth: bool) -> Json:
    """The summary of one method; if it failed, `failure` gives the reason and all numbers are null."""
    tracks = [one.track for one in result.aligned]
    seconds = result.seconds
    return {
        "failure": result.failure or None,
        "reference_frame": result.reference,
        **_judged(result, has_truth),
        "sigma_px": summary_json(summarize([value for one in tracks if (value := one.sigma_px) is not None])),
        "fit_rmse_px": summary_json(summarize([value for one in tracks if (value := one.rmse_px) is not None])),
        "s_per_frame": statistics.median(seconds) if seconds else None,
        "s_per_frame_p95": _p95(seconds),
        "s_total": sum(seconds) if seconds else None,
        "s_reference": _seconds_of_the_reference(result),
        "peak_mb": result.peak_mb,
        "matches": _typical([one.matches for one in tracks]),
        "inliers": _typical([one.inliers for one in tracks]),
        "per_frame": [_frame(one, row) for one, row in frames_of(result)],
    }


def _judged(result: MethodResult, has_truth: bool) -> Json:
    """The part of the summary that the raw frames have as well."""
    judged = result.evaluation
    jitter_px, drift_px = (None, None) if judged is None else unrest_px(judged)
    error = {"error_px": summary_json(result.error_px)} if has_truth else {}
    return {"tracked": result.tracked, "lost": result.lost, **error,
            **{name: summary_json(None if judged is None else judged.summary(name)) for name in MEASURES},
            "jitter_px": jitter_px, "drift_px": drift_px}


def frames_of(result: MethodResult) -> list[tuple[Passage, FrameMetrics | None]]:
    """Every frame with its metrics."""
    rows: Sequence[FrameMetrics | None] = result.evaluation.rows if result.evaluation else [None] * len(result.passages)
    return list(zip(result.passages, rows, strict=True))


def _frame(one: Passage, row: FrameMetrics | None) -> Json:
    return {"frame": one.number, "stamp_ns": one.track.stamp_ns, "status": one.track.state.value,
            "error_px": one.error_px, **_of_track(one.track), "seconds": one.seconds,
            **{name: None if row is None else row[name] for name in MEASURES}}


def _of_track(track: Track) -> Json:
    return {"matches": track.matches, "inliers": track.inliers, "rmse_px": track.rmse_px, "sigma_px": track.sigma_px,
            "lost_reason": None if track.lost_reason is None else track.lost_reason.value}


def _p95(values: Sequence[float]) -> float | None:
    summary = summarize(values)
    return None if summary is None else summary.p95


def _typical(counts: Sequence[int]) -> int | None:
    """The lower median, which is an integer."""
    return statistics.median_low(counts) if counts else None


def _seconds_of_the_reference(result: MethodResult) -> float | None:
    return next((one.seconds for one in result.passages if one.reference), None)
