"""The frames that a report shows: the worst ones, and evenly spaced ones for the scrubber."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from stab_ros.evaluation.frame_metrics import FrameMetrics
from stab_ros.evaluation.results import TopicEvaluation

_WORST = 3
_BY = "displacement_reference_px", "rmse_reference_px"  # the first of these that was measured
_LEAVES = 24


def worst_frames(topic: TopicEvaluation) -> list[int]:
    """Indices of at most three rows, the largest displacement against the reference first."""
    for name in _BY:
        known = [(value, index) for index, row in enumerate(topic.rows) if (value := row[name]) is not None]
        if known:
            return [index for _, index in sorted(known, key=lambda one: -one[0])[:_WORST]]
    return []


def leaves(topic: TopicEvaluation) -> list[FrameMetrics]:
    """At most 24 evenly spaced frames with an image, including the first and the last."""
    pictured = [row for row in topic.rows if row.outcome.has_picture]
    chosen = np.unique(np.linspace(0, len(pictured) - 1, min(_LEAVES, len(pictured))).round().astype(int))
    return [pictured[index] for index in chosen.tolist()]


def partners(topic: TopicEvaluation, frames: Sequence[FrameMetrics]) -> list[FrameMetrics | None]:
    """The frames of another stream with the same stamps; with the same numbers if the two share no stamp."""
    by_stamp = {row.stamp_ns: row for row in topic.rows}
    if any(frame.stamp_ns in by_stamp for frame in frames):
        return [by_stamp.get(frame.stamp_ns) for frame in frames]
    by_number = {row.frame: row for row in topic.rows}
    return [by_number.get(frame.frame) for frame in frames]
