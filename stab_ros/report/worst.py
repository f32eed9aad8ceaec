"""Which frames stand worst."""

from __future__ import annotations

from stab_ros.core.frame_metrics import FrameMetrics
from stab_ros.io.evaluation import TopicEvaluation

_COUNT = 3
_BY = "displacement_reference_px", "rmse_reference_px"  # the first one that was measured


def worst_frames(topic: TopicEvaluation) -> list[FrameMetrics]:
    """At most three, those that are displaced most against the reference first."""
    for name in _BY:
        known = [row for row in topic.measured if row[name] is not None]
        if known:
            return sorted(known, key=lambda row: -(row[name] or 0.0))[:_COUNT]
    return []
