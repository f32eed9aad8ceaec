"""Box plots of the displacement, as in figures 11 to 14 of Ljubicic et al. 2021."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from matplotlib.axes import Axes

from stab_ros.evaluation.results import TopicEvaluation
from stab_ros.metrics.statistics import Summary, summarize
from stab_ros.report.panel import PREVIOUS_COLOR, REFERENCE_COLOR, Panel, drawn, label, new_axes

_KINDS = (
    ("displacement_reference_px", "the reference (initial frame)", REFERENCE_COLOR),
    ("displacement_previous_px", "the previous frame", PREVIOUS_COLOR),
)
_MOVING_COLOR = "#a0a0a0"
_UPRIGHT = 7  # largest number of boxes with horizontal names
_NAMED = 26  # largest number of boxes that all have a name
_DWARFED = 3.0  # ratio to the static points from which moving points may exceed the figure


@dataclass(frozen=True)
class _Box:
    """One box. counts: whether it is part of the means."""

    name: str
    summary: Summary
    counts: bool


def box_panels(topics: Sequence[TopicEvaluation]) -> list[Panel]:
    """Two panels for each stream: against the reference, and against the previous frame."""
    return [_panel(topic, *kind) for topic in topics for kind in _KINDS]


def _panel(topic: TopicEvaluation, name: str, against: str, color: str) -> Panel:
    title = f"{topic.topic}: displacement against {against}"
    boxes = list(_boxes(topic, name))
    if not boxes:
        return Panel(title, "No frame could be measured at a verification point, so there is nothing to draw.")
    figure, axes = new_axes()
    for position, box in enumerate(boxes):
        _draw(axes, position, box, color)
    _name_boxes(axes, boxes)
    cut = _cut_axis(axes, boxes)
    label(axes, "verification point", "displacement, px")
    moving = "" if all(box.counts for box in boxes) else " Grey: moving points, excluded from the means."
    beyond = " Grey numbers: medians in px that lie above the figure." if cut else ""
    return drawn(figure, title, "Box: quartiles and median; whiskers: to the outermost value within 1.5 interquartile "
                 f"ranges; dots: outliers. “mean”: of the static points, frame by frame.{moving}{beyond}",
                 f"Box plots of the displacement in pixels against {against}, one for each verification point.")


def _boxes(topic: TopicEvaluation, name: str) -> Iterator[_Box]:
    overall = topic.summary(name)
    if overall is not None:
        yield _Box("mean", overall, True)
    for index, point in enumerate(topic.points):
        summary = summarize(topic.point_series(name, index))
        if summary is not None:
            yield _Box(point.name, summary, bool(topic.static[index]))


def _draw(axes: Axes, position: int, box: _Box, color: str) -> None:
    summary = box.summary
    shade, line = (color, {"color": "black"}) if box.counts else (_MOVING_COLOR, {"color": _MOVING_COLOR})
    stats: dict[str, Any] = {
        "med": summary.median, "q1": summary.q1, "q3": summary.q3, "whislo": summary.whisker_low,
        "whishi": summary.whisker_high, "fliers": list(summary.outliers)}
    axes.bxp([stats], positions=[position], widths=0.6, patch_artist=True, manage_ticks=False,
             boxprops={"facecolor": shade, "alpha": 0.75}, medianprops={"color": "black"},
             whiskerprops=line, capprops=line, flierprops={"marker": ".", "markersize": 3, "markeredgecolor": shade})


def _name_boxes(axes: Axes, boxes: Sequence[_Box]) -> None:
    """Names every box, or as many as there is space for."""
    every = -(-len(boxes) // _NAMED)
    axes.set_xticks(range(0, len(boxes), every), [box.name for box in boxes[::every]],
                    rotation=0 if len(boxes) <= _UPRIGHT else 90)
    axes.set_xlim(-0.6, len(boxes) - 0.4)


def _cut_axis(axes: Axes, boxes: Sequence[_Box]) -> bool:
    """Limits the axis to the static points where moving ones dwarf them; returns whether medians lie beyond."""
    axes.set_ylim(bottom=0)
    highest, counted = (max((box.summary.max for box in some), default=0.0)
                        for some in (boxes, [box for box in boxes if box.counts]))
    if not 0 < _DWARFED * counted < highest:
        return False
    axes.set_ylim(top=1.25 * counted)
    above = [(at, box.summary.median) for at, box in enumerate(boxes) if box.summary.median > 1.25 * counted]
    for at, median_px in above:
        axes.annotate(f"↑ {median_px:.3g}", (at, 1.0), xycoords=("data", "axes fraction"), xytext=(0, -3), rotation=90,
                      textcoords="offset points", ha="center", va="top", fontsize=9, color="#606060",
                      bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.8})
    return bool(above)
