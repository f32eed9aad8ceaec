"""One row for each method: box plots of the residual motion, bars of time and memory."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from stab_ros.evaluation.comparison_results import Comparison, MethodResult
from stab_ros.evaluation.comparison_summary import method_json
from stab_ros.metrics.statistics import Summary
from stab_ros.report.panel import PREVIOUS_COLOR, REFERENCE_COLOR, Panel, drawn, label, logarithmic, new_axes, shortened

_RAW_COLOR = "#a0a0a0"
_ROW_IN = 0.3
_WIDE = 20.0  # ratio of largest to smallest value from which the axis is logarithmic
_HALF = 0.3  # height of a box
_BOX = "Box: quartiles and median; whiskers: to the outermost value within 1.5 interquartile ranges; dots: outliers."
_LOG = " The axis is logarithmic."
Row = tuple[str, Summary]


def box_panels(comparison: Comparison) -> list[Panel]:
    """Error, if the truth is known, and displacement against the reference and the previous frame."""
    results = (comparison.raw, *comparison.methods)
    panels = [_boxes("Error against the truth", "error", results, lambda one: one.error_px, REFERENCE_COLOR)]
    return [*(panels if comparison.has_truth else []), *(
        _boxes(f"Displacement against {against}", "displacement", results, _of_metric(name), color)
        for against, name, color in (("the reference", "displacement_reference_px", REFERENCE_COLOR),
                                     ("the previous frame", "displacement_previous_px", PREVIOUS_COLOR)))]


def _of_metric(name: str) -> Callable[[MethodResult], Summary | None]:
    return lambda one: None if one.evaluation is None else one.evaluation.summary(name)


def _boxes(title: str, what: str, results: Sequence[MethodResult], of: Callable[[MethodResult], Summary | None],
           color: str) -> Panel:
    rows = [(one.name, summary) for one in results if (summary := of(one)) is not None]
    if not rows:
        return Panel(title, "No frame could be measured, so there is nothing to draw.")
    figure, axes = _rows([name for name, _ in rows])
    for at, (name, summary) in enumerate(rows):
        _draw(axes, at, summary, _RAW_COLOR if name == results[0].name else color)
    log = _scale(axes, [value for _, one in rows for value in (max(one.whisker_low, one.q1 / 3), one.max)])
    label(axes, f"{what}, px", "")
    return drawn(figure, title, f"{_BOX} Grey: the raw frames.{_LOG if log else ''}",
                 f"Box plots of the {what} in pixels, one for each method.")


def _rows(names: Sequence[str]) -> tuple[Figure, Axes]:
    """Axes with a row for each name, the first at the top."""
    figure, axes = new_axes(max(2.0, 1.0 + _ROW_IN * len(names)))
    axes.set_yticks(range(len(names)), list(map(shortened, names)))
    axes.set_ylim(len(names) - 0.4, -0.6)
    axes.grid(False, axis="y")
    return figure, axes


def _draw(axes: Axes, at: int, box: Summary, color: str) -> None:
    axes.barh(at, box.q3 - box.q1, 2 * _HALF, left=box.q1, facecolor=color, alpha=0.75, edgecolor="black",
              linewidth=0.7)
    for low, high in ((box.whisker_low, box.q1), (box.q3, box.whisker_high)):
        axes.plot([low, high], [at, at], color="black", linewidth=0.8)
    axes.plot([box.median, box.median], [at - _HALF, at + _HALF], color="black", linewidth=1.6)
    axes.plot(box.outliers, [at] * len(box.outliers), ".", markersize=3, color=color)


def _scale(axes: Axes, values: Sequence[float]) -> bool:
    """Scales the axis from zero, or logarithmically for a wide range; returns whether it is logarithmic."""
    known = [value for value in values if value > 0]
    if known and max(known) > _WIDE * min(known):
        logarithmic(axes, "x", 0.6 * min(known), 1.6 * max(known))
        return True
    axes.set_xlim(left=0)
    return False


def cost_panels(comparison: Comparison) -> list[Panel]:
    """Time and memory of each method."""
    found = {one.name: method_json(one, comparison.has_truth) for one in comparison.methods}
    return [
        _bars("Time for a frame", "time for a frame, s", {name: one["s_per_frame"] for name, one in found.items()},
              "Median over the frames after the reference: tracking and warping, without decoding."),
        _bars("Peak memory", "memory, MB", {name: one["peak_mb"] for name, one in found.items()},
              "The most that the process of the method has held, with libraries and decoding."),
    ]


def _bars(title: str, axis: str, values: dict[str, float | None], caption: str) -> Panel:
    known = {name: value for name, value in values.items() if value is not None}
    if not known:
        return Panel(title, "No method came to its end, so there is nothing to draw.")
    figure, axes = _rows(list(known))
    axes.barh(range(len(known)), list(known.values()), 2 * _HALF, color=REFERENCE_COLOR, alpha=0.8)
    log = _scale(axes, list(known.values()))
    label(axes, axis, "")
    return drawn(figure, title, caption + (_LOG if log else ""), f"{title} of each method, as bars; {axis}.")
