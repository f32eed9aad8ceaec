"""The worst frames over the reference: edges of the reference in red, of the frame in cyan, white where they agree."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from markupsafe import Markup
from matplotlib.patches import Rectangle

from stab_ros.core.types import Gray, Image
from stab_ros.evaluation.findings import frame_name
from stab_ros.evaluation.frame_metrics import FrameMetrics
from stab_ros.evaluation.results import TopicEvaluation
from stab_ros.report.numbers import Numbers
from stab_ros.report.panel import Panel, drawn, gray_of, new_axes, picture_height_in, show_picture
from stab_ros.report.pictures import ReportImages
from stab_ros.report.sampling import worst_frames

_CROP_PX = 240
_SHOWN_PX = 760  # width of the image in a panel
_SMOOTH_PX = 1.2
_EDGE_SHARE = 90.0  # percentile of the gradient above which a pixel is an edge; Canny's low threshold is _WEAK of it
_WEAK = 0.4
_BACKGROUND = 0.3  # brightness of the image behind its edges
_COLORS = "Edges of the reference red, of the frame cyan, white where they agree."
_CAPTIONS = (("displacement_reference_px", "Displaced by {} px"), ("rmse_reference_px", "RMSE {} px"),
         ("rmsd_reference", "RMSD {} grey levels"))


@dataclass(frozen=True, eq=False)
class Pair:
    """A frame and the reference, (h, w) uint8 each. x, y: centre of the part that is shown; place: its description."""

    title: str
    reference: Gray
    current: Gray
    x_px: int
    y_px: int
    place: str

    @property
    def box(self) -> tuple[int, int, int]:
        """Left, top and side of the part, px, within the image."""
        height, width = self.reference.shape
        side = min(_CROP_PX, height, width)
        return (min(max(self.x_px - side // 2, 0), width - side), min(max(self.y_px - side // 2, 0), height - side),
                side)


def overlay_panels(topics: Sequence[TopicEvaluation], pictures: ReportImages, numbers: Numbers) -> list[Panel]:
    """Two panels for each of the worst frames: the whole image, and a part at full resolution."""
    return [panel for topic in topics for panel in _of_topic(topic, pictures, numbers)]


def _of_topic(topic: TopicEvaluation, pictures: ReportImages, numbers: Numbers) -> Iterator[Panel]:
    rows = [index for index in worst_frames(topic) if (topic.topic, topic.rows[index].stamp_ns) in pictures.whole]
    if not rows:
        yield Panel(f"{topic.topic}: worst frames", "No frame was measured against the reference, so there is nothing "
                    "to draw.")
    for index in rows:
        row = topic.rows[index]
        pair = Pair(f"{topic.topic}: {frame_name(row)}", gray_of(topic.reference),
                     pictures.whole[topic.topic, row.stamp_ns], *worst_place(topic, row))
        yield _whole(pair, _caption_of(topic, index, numbers))
        yield part(pair)


def _caption_of(topic: TopicEvaluation, index: int, numbers: Numbers) -> Markup:
    """The metrics of this frame, for its caption."""
    return Markup(", ").join(Markup(text).format(numbers("topics", topic.topic, "per_frame", index, name))
                             for name, text in _CAPTIONS if topic.rows[index][name] is not None)


def worst_place(topic: TopicEvaluation, row: FrameMetrics) -> tuple[int, int, str]:
    """The static point with the largest displacement, else the image centre: x and y in px, and a description."""
    displaced = np.where(topic.static, row.points["displacement_reference_px"], np.nan)
    if not np.isfinite(displaced).any():
        return topic.reference.size[0] // 2, topic.reference.size[1] // 2, "The middle of the picture"
    point = topic.points[int(np.nanargmax(displaced))]
    return point.x_px, point.y_px, f"About {point.name}, the verification point that is displaced most"


def _whole(pair: Pair, metrics: Markup) -> Panel:
    height, width = pair.reference.shape
    left, top, side = pair.box
    small = (_SHOWN_PX, round(height * _SHOWN_PX / width))
    figure, axes = new_axes(picture_height_in(width, height))
    both = (cv2.resize(gray, small, interpolation=cv2.INTER_AREA) for gray in (pair.reference, pair.current))
    show_picture(axes, overlaid(*both), (-0.5, width - 0.5, height - 0.5, -0.5))
    axes.add_patch(Rectangle((left, top), side, side, fill=False, edgecolor="#ffd23f", linewidth=1.5))
    return drawn(figure, pair.title, Markup("{}. {} Yellow: the part in the next figure.").format(metrics, _COLORS),
                 f"{pair.title}: edges of the reference in red, of the frame in cyan.", photo=True)


def part(pair: Pair, metrics: Markup | str = "") -> Panel:
    """The part around the place at full resolution. metrics: text before the caption."""
    left, top, side = pair.box
    figure, axes = new_axes(picture_height_in(1, 1))
    image = overlaid(pair.reference, pair.current)[top : top + side, left : left + side]
    show_picture(axes, image, (left - 0.5, left + side - 0.5, top + side - 0.5, top - 0.5))
    caption = Markup("{}{}, at full resolution. {}").format(metrics, pair.place, _COLORS)
    return drawn(figure, f"{pair.title}, part", caption,
                 f"{pair.title}: a part of the edges, pixel by pixel.", photo=True)


def overlaid(reference: Gray, current: Gray) -> Image:
    """(h, w, 3) uint8 RGB: the edges of both (h, w) uint8 images, over their darkened mean."""
    background = _BACKGROUND * (reference.astype(np.float32) + current) / 2
    red, cyan = (np.where(edges(gray) > 0, 255.0, background) for gray in (reference, current))
    return np.asarray(np.stack([red, cyan, cyan], axis=2).round(), np.uint8)


def edges(gray: Gray) -> Gray:
    """(h, w) uint8, 255 along the edges: Canny 1986, with thresholds by the contrast of the image."""
    smooth = cv2.GaussianBlur(gray, (0, 0), _SMOOTH_PX)
    dx, dy = cv2.spatialGradient(smooth)
    strong = max(float(np.percentile(np.abs(dx).astype(np.float32) + np.abs(dy), _EDGE_SHARE)), 1.0)
    return np.asarray(cv2.Canny(dx, dy, _WEAK * strong, strong))
