"""Box plots of the displacement, as in Ljubicic et al. 2021, figures 11 to 14."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from stab_ros.io.evaluation import TopicEvaluation
from stab_ros.metrics.statistics import Summary, summarize
from stab_ros.report.panel import PREVIOUS_COLOR, REFERENCE_COLOR, Panel, drawn, label, new_axes

_KINDS = (
    ("displacement_reference_px", "the reference (initial frame)", REFERENCE_COLOR),
    ("displacement_previous_px", "the previous frame", PREVIOUS_COLOR),
)
_MOVING_COLOR = "#a0a0a0"


def box_panels(topics: Sequence[TopicEvaluation]) -> list[Panel]:
    """For each stream two: against the reference, and against the frame before."""
    return [_panel(topic, *kind) for topic in topics for kind in _KINDS]


def _panel(topic: TopicEvaluation, name: str, against: str, color: str) -> Panel:
    title = f"{topic.topic}: displacement against {against}"
    boxes = list(_boxes(topic, name, color))
    if not boxes:
        return Panel(title, "No frame could be measured at a verification point, so there is nothing to draw.")
    figure, axes = new_axes()
    for position, (_, summary, shade) in enumerate(boxes):
        axes.bxp([_stats(summary)], positions=[position], widths=0.6, patch_artist=True, manage_ticks=False,
                 boxprops={"facecolor": shade, "alpha": 0.75}, medianprops={"color": "black"},
                 flierprops={"marker": ".", "markersize": 3, "markeredgecolor": shade})
    axes.set_xticks(range(len(boxes)), [text for text, _, _ in boxes], rotation=60 if len(boxes) > 7 else 0)
    axes.set_ylim(bottom=0)
    label(axes, "verification point", "displacement, px")
    moving = " Grey: moves on its own, left out of the means." if not topic.static.all() else ""
    return drawn(figure, title, "Box: quartiles and median; whiskers: to the outermost value within 1.5 interquartile "
                 f"ranges; dots: outliers. “mean”: of the static points, frame by frame.{moving}",
                 f"Box plots of the displacement in pixels against {against}, one for each verification point.")


def _boxes(topic: TopicEvaluation, name: str, color: str) -> Iterator[tuple[str, Summary, str]]:
    """Label, statistics and colour."""
    overall = topic.summary(name)
    if overall is not None:
        yield "mean", overall, color
    for index, point in enumerate(topic.points):
        summary = summarize(topic.point_series(name, index))
        if summary is not None:
            yield point.name, summary, color if topic.static[index] else _MOVING_COLOR


def _stats(summary: Summary) -> dict[str, Any]:
    return {"med": summary.median, "q1": summary.q1, "q3": summary.q3, "whislo": summary.whisker_low,
            "whishi": summary.whisker_high, "fliers": list(summary.outliers)}
