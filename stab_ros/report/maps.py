"""Maps on the reference frame: the residual velocity field, and the verification points."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Rectangle
from matplotlib.patheffects import withStroke

from stab_ros.core.text import counted
from stab_ros.core.types import FloatArray
from stab_ros.evaluation.results import TopicEvaluation
from stab_ros.metrics.velocity_field import Field
from stab_ros.metrics.verification import VerificationPoint
from stab_ros.report.panel import Panel, drawn, gray_of, new_axes, picture_height_in, show_picture

_VECTOR_COLOR, _REGION_COLOR = "#ffd23f", "#ff3b30"
_STATIC_COLOR, _MOVING_COLOR = "#35e06b", "#ff3b30"
_LONGEST = 0.09  # length of the longest vectors, as a share of the image width
_KEYS = (1.0, 2.0, 5.0)
_NAME_SHARE = 0.15  # share of the width that a name may occupy


def field_panels(topics: Sequence[TopicEvaluation]) -> list[Panel]:
    """One panel for each stream, the raw one first."""
    return [_field_panel(topic) for topic in topics]


def _field_panel(topic: TopicEvaluation) -> Panel:
    title = f"{topic.topic}: residual velocity field"
    field = topic.field
    if field is None or not np.isfinite(field.shifts_px).any():
        return Panel(title, "No vector could be measured, so there is no field to draw.")
    width, height = topic.reference.size
    figure, axes = new_axes(picture_height_in(width, height))
    show_picture(axes, gray_of(topic.reference) * 0.6)
    scale = _draw_vectors(axes, field, width)
    axes.set_xlim(-0.5, width - 0.5)
    axes.set_ylim(height - 0.5, -0.5)
    return drawn(figure, title, f"Over the reference. Yellow: areas; red: means of the {len(field.regions)} "
                 f"sub-regions, mean over the frames where the field was measured; the key shows {scale:g} px.",
                 "Arrows on the reference picture: in which direction, and how far in pixels, the ground still moves.",
                 photo=True)


def _draw_vectors(axes: Axes, field: Field, width: int) -> float:
    """Draws the vectors; returns the length of the key, px."""
    lengths = np.hypot(*field.shifts_px.T)
    longest = max(float(np.nanpercentile(lengths, 95)), 1e-3)
    per_px = _LONGEST * width / longest
    key_px = _round_length(longest)
    at = np.isfinite(lengths)
    look: dict[str, Any] = {"angles": "xy", "scale_units": "xy", "scale": 1 / per_px}
    areas = axes.quiver(*field.centres_px[at].T, *field.shifts_px[at].T, color=_VECTOR_COLOR, width=0.004, **look)
    means = _means(field)
    axes.quiver(*means[:, :2].T, *means[:, 2:].T, color=_REGION_COLOR, width=0.007, **look)
    axes.quiverkey(areas, 0.86, 1.03, key_px, f"{key_px:g} px", labelpos="E", coordinates="axes", color="black")
    return key_px


def _means(field: Field) -> FloatArray:
    """(regions, 4): x, y, u, v."""
    return np.array([(r.x_px, r.y_px, r.u_px, r.v_px) for r in field.regions if r.vectors]).reshape(-1, 4)


def _round_length(length_px: float) -> float:
    """A round number of at most this length."""
    decade = 10 ** np.floor(np.log10(length_px))
    return float(max(key * decade for key in _KEYS if key * decade <= length_px * 1.001))


def point_panels(topics: Sequence[TopicEvaluation]) -> list[Panel]:
    """The positions of the verification points: one panel for each distinct set of points."""
    shown = {tuple((point.x_px, point.y_px, static) for point, static in zip(topic.points, topic.static, strict=True)):
             topic for topic in topics}
    return [_point_panel(topic) for topic in shown.values()]


def _point_panel(topic: TopicEvaluation) -> Panel:
    title = f"{topic.topic}: verification points"
    if not topic.points:
        return Panel(title, "The reference has no suitable place for a verification point.")
    width, height = topic.reference.size
    figure, axes = new_axes(picture_height_in(width, height))
    show_picture(axes, gray_of(topic.reference) * 0.7)
    for point, static in zip(topic.points, topic.static, strict=True):
        _mark_point(axes, point, bool(static), width)
    return drawn(figure, title, "The windows that RMSD is measured in, on the reference. Green: static; red, dotted: "
                 "moving, excluded from the means.",
                 f"The reference picture with the windows of {counted(len(topic.points), 'verification point')}.",
                 photo=True)


def _mark_point(axes: Axes, point: VerificationPoint, static: bool, width: int) -> None:
    """Draws the window of a point, and its name on the side with enough space."""
    side, color = point.calibration.window_px, _STATIC_COLOR if static else _MOVING_COLOR
    left, top = point.x_px - side / 2, point.y_px - side / 2
    axes.add_patch(Rectangle((left, top), side, side, fill=False, edgecolor=color, linewidth=1.4,
                             linestyle="-" if static else ":"))
    at_right = left + side < (1 - _NAME_SHARE) * width
    axes.annotate(point.name, (left + side if at_right else left, point.y_px), xytext=(3 if at_right else -3, 0),
                  textcoords="offset points", va="center", ha="left" if at_right else "right", color=color, fontsize=11,
                  fontweight="bold", path_effects=[withStroke(linewidth=2.5, foreground="black")])
