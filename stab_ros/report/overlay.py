"""The worst frames over the reference: edges of the reference red, of the frame cyan, and white where both agree."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import cv2
import numpy as np
from matplotlib.patches import Rectangle

from stab_ros.core.findings import frame_name
from stab_ros.core.frame_metrics import FrameMetrics
from stab_ros.core.types import Gray, Image
from stab_ros.io.evaluation import TopicEvaluation
from stab_ros.report.numbers import shown
from stab_ros.report.panel import Panel, drawn, gray_of, new_axes, picture_height_in, show_picture
from stab_ros.report.pictures import Pictures
from stab_ros.report.worst import worst_frames

_CROP_PX = 160
_SHOWN_PX = 760  # width of the picture in a panel
_SMOOTH_PX = 1.2
_EDGE_SHARE = 90.0  # percentile of the gradient that an edge exceeds, and its weak continuation
_WEAK = 0.4
_BACKGROUND = 0.3  # how bright the picture is behind its edges


def overlay_panels(topics: Sequence[TopicEvaluation], pictures: Pictures) -> list[Panel]:
    """For each of the worst frames two: the whole picture, and a part of it pixel by pixel."""
    return [panel for topic in topics for panel in _of_topic(topic, pictures)]


def _of_topic(topic: TopicEvaluation, pictures: Pictures) -> Iterator[Panel]:
    rows = [row for row in worst_frames(topic) if (topic.topic, row.stamp_ns) in pictures.whole]
    if not rows:
        yield Panel(f"{topic.topic}: worst frames", "No frame was measured against the reference.")
    reference = gray_of(topic.reference)
    for row in rows:
        current = pictures.whole[topic.topic, row.stamp_ns]
        yield from _of_frame(topic, row, reference, current)


def _of_frame(topic: TopicEvaluation, row: FrameMetrics, reference: Gray, current: Gray) -> Iterator[Panel]:
    name, (left, top) = frame_name(row), _corner(topic, row, reference)
    side = min(_CROP_PX, *reference.shape)
    cut = np.s_[top : top + side, left : left + side]
    height, width = reference.shape
    figure, axes = new_axes(picture_height_in(width, height))
    small = (_SHOWN_PX, round(height * _SHOWN_PX / width))
    whole = overlaid(*(cv2.resize(gray, small, interpolation=cv2.INTER_AREA) for gray in (reference, current)))
    show_picture(axes, whole, (-0.5, width - 0.5, height - 0.5, -0.5))
    axes.add_patch(Rectangle((left, top), side, side, fill=False, edgecolor="#ffd23f", linewidth=1.5))
    colors = "Edges of the reference red, of the frame cyan, white where they agree."
    alt = f"Edges of the reference in red and of {name} in cyan"
    yield drawn(figure, f"{topic.topic}: {name}", f"{_numbers(row)}. {colors} Yellow: the part beside it.", f"{alt}.",
                photo=True)
    figure, axes = new_axes(picture_height_in(1, 1) * 0.8)
    extent = left - 0.5, left + side - 0.5, top + side - 0.5, top - 0.5
    show_picture(axes, overlaid(reference, current)[cut], extent)
    yield drawn(figure, f"{topic.topic}: part of {name}",
                f"About the verification point that is displaced most. {colors}", f"{alt}, pixel by pixel.", photo=True)


def _numbers(row: FrameMetrics) -> str:
    told = (("displacement_reference_px", "displaced by {} px"), ("rmse_reference_px", "RMSE {} px"),
            ("rmsd_reference", "RMSD {} grey levels"))
    return ", ".join(text.format(shown(row[name])) for name, text in told if row[name] is not None)


def _corner(topic: TopicEvaluation, row: FrameMetrics, reference: Gray) -> tuple[int, int]:
    """Left and top of the part that is shown: about the static point that is displaced most, else the middle."""
    side, (height, width) = min(_CROP_PX, *reference.shape), reference.shape
    x, y = width // 2, height // 2
    displaced = np.where(topic.static, row.points["displacement_reference_px"], np.nan)
    if np.isfinite(displaced).any():
        point = topic.points[int(np.nanargmax(displaced))]
        x, y = point.x_px, point.y_px
    return min(max(x - side // 2, 0), width - side), min(max(y - side // 2, 0), height - side)


def overlaid(reference: Gray, current: Gray) -> Image:
    """(h, w, 3) uint8 RGB: the edges of both (h, w) uint8 pictures, over what they look like."""
    background = _BACKGROUND * (reference.astype(np.float32) + current) / 2
    red, cyan = (np.where(edges(gray) > 0, 255.0, background) for gray in (reference, current))
    return np.asarray(np.stack([red, cyan, cyan], axis=2).round(), np.uint8)


def edges(gray: Gray) -> Gray:
    """(h, w) uint8, 255 along the edges: Canny's, with thresholds by the picture's own contrast."""
    smooth = cv2.GaussianBlur(gray, (0, 0), _SMOOTH_PX)
    dx, dy = cv2.spatialGradient(smooth)
    strong = max(float(np.percentile(np.abs(dx).astype(np.float32) + np.abs(dy), _EDGE_SHARE)), 1.0)
    return np.asarray(cv2.Canny(dx, dy, _WEAK * strong, strong))
