"""The messages of the evaluator: `metrics` of each frame, and single values for plotting tools."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from rosbags.typesys.stores import ros2_jazzy as ros

from stab_ros.core.text import number
from stab_ros.evaluation.frame_metrics import POINT_METRICS, UNITS, FrameMetrics, Outcome
from stab_ros.io.cdr import FLOAT64, Header, serialize
from stab_ros.io.diagnostics_message import OK, WARN, status_cdr


def metrics_cdr(metrics: FrameMetrics, point_names: Sequence[str], header: Header) -> bytes:
    """DiagnosticArray with one status for the frame; what was not measured is an empty string.

    Keys are those of UNITS, and for each verification point those of POINT_METRICS, as `rmsd_reference.V1`.
    """
    values = {"outcome": metrics.outcome.value, "frame": str(metrics.frame)}
    values |= {name: number(metrics[name]) for name in UNITS}
    for name in POINT_METRICS:
        of_points = metrics.points.get(name, np.empty(0)).tolist()
        values |= {f"{name}.{point}": number(value) if np.isfinite(value) else ""
                   for point, value in zip(point_names, of_points, strict=False)}
    level = WARN if metrics.outcome is Outcome.LOST else OK
    return status_cdr(header, "metrics", header.frame_id, level, metrics.outcome.value, values)


def float64_cdr(value: float) -> bytes:
    """std_msgs/Float64."""
    return serialize(ros.std_msgs__msg__Float64(data=value), FLOAT64)
