"""RMSD, displacement and RMSE of every frame over time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes

from stab_ros.core.text import counted
from stab_ros.core.types import FloatArray
from stab_ros.evaluation.results import TopicEvaluation
from stab_ros.report.panel import LOST_COLOR, Panel, drawn, label, legend, new_axes, stream_color

_MEASURES = (
    ("displacement", "Displacement", "px", "displacement_reference_px", "displacement_previous_px"),
    ("RMSE", "RMSE of homologous points", "px", "rmse_reference_px", "rmse_previous_px"),
    ("RMSD", "RMSD", "grey levels", "rmsd_reference", "rmsd_previous"),
)
_WIDE = 20.0  # ratio of the largest value to the smallest median from which the axis is logarithmic
_SPARSE = 60  # largest number of values that are drawn with markers
_LEGEND_IN = 0.42  # height of the two lines of a stream


def series_panels(topics: Sequence[TopicEvaluation]) -> list[Panel]:
    """One panel for each metric, with all streams."""
    return [_panel(topics, *measure) for measure in _MEASURES]


def _panel(topics: Sequence[TopicEvaluation], short: str, title: str, unit: str, *names: str) -> Panel:
    figure, axes = new_axes(3.5 + _LEGEND_IN * len(topics))
    drawn_any = False
    for index, topic in enumerate(topics):
        color = stream_color(index)
        for name, style in zip(names, ("-", ":"), strict=True):
            against = "reference" if "reference" in name else "previous"
            drawn_any |= _line(axes, topic, name, f"{topic.topic}, {against}", color, style)
    if not drawn_any:
        return Panel(f"{title} over time", f"No frame has {_article(short)} {short}, so there is nothing to draw.")
    lost = _mark_lost(axes, topics)
    if _is_wide(topics, names):
        axes.set_yscale("log")
    else:
        axes.set_ylim(bottom=0)
    label(axes, "time since the first frame, s", f"{short}, {unit}")
    legend(axes)
    return drawn(figure, f"{title} over time", "Solid: against the reference; dotted: against the previous frame."
                 + (" Red ticks at the bottom: frames that were lost or have no picture." if lost else ""),
                 f"{title} in {unit} of every frame over time in seconds, for {counted(len(topics), 'stream')} of "
                 "pictures.")


def _article(word: str) -> str:
    return "an" if word.startswith("R") else "a"


def _line(axes: Axes, topic: TopicEvaluation, name: str, meaning: str, color: str, style: str) -> bool:
    """Draws one line; returns whether it has values."""
    rows = [(row.stamp_ns, value) for row in topic.measured if (value := row[name]) is not None]
    if not rows:
        return False
    stamps_ns, values = np.array([stamp for stamp, _ in rows]), [value for _, value in rows]
    axes.plot(_seconds(topic, stamps_ns), values, color=color, linestyle=style, linewidth=1.3, label=meaning,
              marker="." if len(rows) <= _SPARSE else "", markersize=4)
    return True


def _seconds(topic: TopicEvaluation, stamps_ns: FloatArray) -> FloatArray:
    return np.asarray((stamps_ns - topic.rows[0].stamp_ns) / 1e9)


def _mark_lost(axes: Axes, topics: Sequence[TopicEvaluation]) -> bool:
    found = False
    for topic in topics:
        gone = [row.stamp_ns for row in topic.rows if not row.outcome.has_picture]
        if gone:
            found = True
            axes.plot(_seconds(topic, np.array(gone)), np.zeros(len(gone)), "|", color=LOST_COLOR, markersize=12,
                      markeredgewidth=2, transform=axes.get_xaxis_transform(), clip_on=False)
    return found


def _is_wide(topics: Sequence[TopicEvaluation], names: Sequence[str]) -> bool:
    summaries = [summary for topic in topics for name in names if (summary := topic.summary(name)) is not None]
    least = min((summary.median for summary in summaries if summary.median > 0), default=0.0)
    return bool(least) and max(summary.max for summary in summaries) > _WIDE * least
