"""Does the picture stand still? One answer from all measures of a stream, or why there is none."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Any

from stab_ros.evaluation.results import TopicEvaluation
from stab_ros.metrics.statistics import Summary

_SIFT_SHARE = 2.0  # of the limit: SIFT has an error of its own, and sees relief
_FACTOR = 2.0  # between two measures that agree
_SIFT_FLOOR_PX = 1.0  # below it, SIFT and relief explain the difference
_FEWEST_POINTS = 2
_FEWEST_CHECKPOINTS = 24
_FEWEST_CHECKED = 3  # frames in which homologous points were found, for a statement about all


class Answer(Enum):
    """What a verdict says of a stream."""

    STILL = "still"
    MOVES = "moves"
    UNKNOWN = "cannot tell"


@dataclass(frozen=True)
class Verdict:
    """An answer. moves_px: the median motion against the reference, px, if any is known; at_least: or more.

    up_to_px: of 95 % of the frames. reason: why nothing can be said, in one sentence; else "".
    """

    answer: Answer
    moves_px: float | None = None
    up_to_px: float | None = None
    at_least: bool = False
    reason: str = ""

    def as_json(self) -> dict[str, Any]:
        """As it stands in the JSON of an evaluation."""
        return {"answer": self.answer.value, "moves_px": self.moves_px, "up_to_px": self.up_to_px,
                "at_least": self.at_least, "reason": self.reason}


def verdict_of(topic: TopicEvaluation) -> Verdict:
    """The verdict on a stream, by the thresholds of its settings for a warning."""
    points, homologous = topic.summary("displacement_reference_px"), topic.summary("rmse_reference_px")
    reason = _no_measure(topic, points, homologous) or _contradiction(topic, points, homologous)
    if reason:
        return Verdict(Answer.UNKNOWN, reason=reason)
    saturated = is_saturated(topic)
    measure = _larger(points, homologous, saturated)
    limit_px = topic.config.displacement_warn_px * (1.0 if measure is points else _SIFT_SHARE)
    answer = Answer.STILL if measure.p95 < limit_px else Answer.MOVES
    return Verdict(answer, measure.median, measure.p95, measure is points and saturated)


def _larger(points: Summary | None, homologous: Summary | None, saturated: bool) -> Summary:
    """The displacement, unless it is unknown or cut at its range, or what is found again has moved far more.

    Homologous points are sought in every tenth frame only: a few of them do not stand for a short recording.
    """
    few = homologous is not None and homologous.count < _FEWEST_CHECKED and points is not None
    if homologous is None or few:
        assert points is not None  # else there is a reason to say nothing
        return points
    cut = points is None or saturated or homologous.median > max(_FACTOR * points.median, _SIFT_FLOOR_PX)
    return homologous if cut or points is None else points


def is_saturated(topic: TopicEvaluation, name: str = "median") -> bool:
    """Whether in the median frame (or that with the largest value, "max") some points are beyond their range."""
    beyond = topic.summary("points_beyond_range")
    return beyond is not None and float(getattr(beyond, name)) > 0


def _no_measure(topic: TopicEvaluation, points: Summary | None, homologous: Summary | None) -> str:
    """Why there is nothing to judge by, or ""."""
    frozen, used, checks = (topic.summary(name) for name in ("identical_frames", "points_used", "checkpoints"))
    if frozen is not None and frozen.median >= topic.config.frozen_frames:
        return "the same picture is repeated again and again, so nothing is seen of the motion"
    if points is None and homologous is None:
        return "nothing could be measured: the pictures show no ground that is found again"
    few = used is None or used.median < _FEWEST_POINTS
    if few and (homologous is None or checks is None or checks.median < _FEWEST_CHECKPOINTS):
        return "fewer than two verification points can be seen, and few points are found again"
    return ""


def _contradiction(topic: TopicEvaluation, points: Summary | None, homologous: Summary | None) -> str:
    """In what the two measures contradict each other, or ""."""
    if points is None or homologous is None:
        return ""
    limit_px = topic.config.displacement_warn_px
    here, there = points.median >= limit_px, homologous.median >= _SIFT_SHARE * limit_px
    low, high = sorted((points.median, homologous.median))
    if here == there or high < _FACTOR * low:
        return ""
    if there:
        return ("the verification points stand still, and what is found again all over the picture has moved: the "
                "points may lie on something fixed to the camera, or that may be water")
    return ("the verification points have changed, and what is found again all over the picture stands still: that is "
            "light, blur, compression or dirt, or the points lie on something that moves")
