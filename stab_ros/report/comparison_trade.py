"""Time of each method against its accuracy."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from matplotlib.axes import Axes

from stab_ros.evaluation.comparison_results import Comparison
from stab_ros.evaluation.comparison_summary import method_json
from stab_ros.report.panel import REFERENCE_COLOR, Panel, drawn, label, logarithmic, new_axes, shortened

_NAME_IN = 0.19  # height of a name in the list beside the axes


@dataclass(frozen=True)
class _Point:
    name: str
    seconds: float
    px: float


def trade_panel(comparison: Comparison) -> Panel:
    """A point for each method; the lower left is better."""
    title, what = "Time and accuracy", "error" if comparison.has_truth else "displacement"
    points = sorted(_points(comparison), key=lambda one: one.px)
    if not points:
        return Panel(title, "No method has both a time and an accuracy, so there is nothing to draw.")
    figure, axes = new_axes(max(3.8, 1.0 + _NAME_IN * len(points)))
    seconds = [one.seconds for one in points]
    axes.plot(seconds, [one.px for one in points], "o", color=REFERENCE_COLOR, markersize=6)
    logarithmic(axes, "x", 0.7 * min(seconds), 1.4 * max(seconds))
    logarithmic(axes, "y", 0.8 * points[0].px, 1.25 * points[-1].px)
    _name(axes, points)
    label(axes, "time for a frame, s", f"median {what}, px")
    return drawn(figure, title, f"Median time for a frame and median {what} of each method: lower is more "
                 "accurate, further left is faster. Both axes are logarithmic.",
                 f"Median {what} in pixels over time for a frame in seconds, a point for each method.")


def _points(comparison: Comparison) -> list[_Point]:
    found = [(one.name, method_json(one, comparison.has_truth)) for one in comparison.methods]
    measure = "error_px" if comparison.has_truth else "displacement_reference_px"
    return [_Point(name, one["s_per_frame"], one[measure]["median"]) for name, one in found
            if one["s_per_frame"] and one[measure]["median"]]


def _name(axes: Axes, points: Sequence[_Point]) -> None:
    """Writes the names in a column beside the axes, in the order of the points, so that they do not overlap."""
    heights = _apart([axes.transAxes.inverted().transform(axes.transData.transform((one.seconds, one.px)))[1]
                      for one in points], 0.9 / max(len(points), 15))
    for one, height in zip(points, heights, strict=True):
        axes.annotate(shortened(one.name), (one.seconds, one.px), xytext=(1.04, height), textcoords="axes fraction",
                      va="center", ha="left", fontsize=9.5, annotation_clip=False,
                      arrowprops={"arrowstyle": "-", "color": "#9aa4ae", "linewidth": 0.7, "relpos": (0.0, 0.5),
                                  "shrinkA": 2, "shrinkB": 3})


def _apart(heights: Sequence[float], gap: float) -> list[float]:
    """Ascending heights in [0, 1], moved as little as possible to be `gap` apart (pool adjacent violators)."""
    pools: list[tuple[float, int]] = []  # mean and count of pooled neighbours
    for index, height in enumerate(heights):
        mean, count = height - index * gap, 1
        while pools and pools[-1][0] > mean:
            before, many = pools.pop()
            mean, count = (before * many + mean * count) / (many + count), many + count
        pools.append((mean, count))
    highest = 1.0 - (len(heights) - 1) * gap
    bases = [min(max(mean, 0.0), highest) for mean, count in pools for _ in range(count)]
    return [base + index * gap for index, base in enumerate(bases)]
