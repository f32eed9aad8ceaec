"""Error and displacement of every frame over time, a few methods per figure, all on the same scale."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from matplotlib.axes import Axes

from stab_ros.evaluation.comparison_results import Comparison, MethodResult, Passage
from stab_ros.evaluation.comparison_summary import frames_of
from stab_ros.evaluation.frame_metrics import FrameMetrics
from stab_ros.report.panel import Panel, drawn, label, legend, logarithmic, new_axes

_COLORS = ("#1f6fb2", "#e08214", "#3b8a4d", "#8a4d9e", "#b5446e", "#6b6b6b")  # as many lines as are distinguishable
_WIDE = 20.0  # ratio of largest to smallest value from which the axis is logarithmic
_LEGEND_IN = 0.2
_TICK = 0.035  # height of a row of ticks, of the axes
_LOST = " Ticks at the bottom, in the colour of the method: frames that it has lost."
_SPARSE = 60  # largest number of values that are drawn with markers
Value = Callable[[Passage, FrameMetrics | None], float | None]


@dataclass(frozen=True)
class _Line:
    """A line. seconds: since the first frame. values: px, NaN where unknown. lost: of lost frames, s."""

    name: str
    seconds: tuple[float, ...]
    values: tuple[float, ...]
    lost: tuple[float, ...]

    @property
    def known(self) -> list[float]:
        return [value for value in self.values if math.isfinite(value)]


def series_panels(comparison: Comparison) -> list[Panel]:
    """The panels of all methods that did not fail."""
    kinds: list[tuple[str, str, Value]] = [
        ("Displacement over time", "displacement", _displacement_px)]
    if comparison.has_truth:
        kinds.insert(0, ("Error over time", "error", lambda one, _: one.error_px))
    return [panel for title, what, value in kinds for panel in _panels(comparison, title, what, value)]


def _displacement_px(_: Passage, row: FrameMetrics | None) -> float | None:
    return None if row is None else row["displacement_reference_px"]


def _panels(comparison: Comparison, title: str, what: str, value: Value) -> Iterator[Panel]:
    lines = [_line(one, value) for one in comparison.methods if not one.failure]
    known = [number for line in lines for number in line.known]
    if not known:
        yield Panel(title, "No frame could be measured, so there is nothing to draw.")
        return
    figures = -(-len(lines) // len(_COLORS))
    for number in range(figures):
        group = lines[number * len(lines) // figures : (number + 1) * len(lines) // figures]
        part = f" ({number + 1} of {figures})" if figures > 1 else ""
        yield _panel(title + part, what, group, known)


def _line(result: MethodResult, value: Value) -> _Line:
    frames = frames_of(result)
    begin_ns = frames[0][0].track.stamp_ns if frames else 0
    seconds = tuple((one.track.stamp_ns - begin_ns) / 1e9 for one, _ in frames)
    values = [value(one, row) for one, row in frames]
    lost = tuple(at for at, (one, _) in zip(seconds, frames, strict=True) if not one.track.tracked)
    return _Line(result.name, seconds, tuple(math.nan if one is None else one for one in values), lost)


def _panel(title: str, what: str, lines: Sequence[_Line], known: Sequence[float]) -> Panel:
    figure, axes = new_axes(3.6 + _LEGEND_IN * len(lines))
    for line, color in zip(lines, _COLORS, strict=False):
        axes.plot(line.seconds, line.values, color=color, linewidth=1.3, label=line.name, markersize=4,
                  marker="." if len(line.known) <= _SPARSE else "")
    log = _scale(axes, known)
    _mark_lost(axes, lines)
    label(axes, "time since the first frame, s", f"{what}, px")
    legend(axes)
    caption = (f"The {what} of every frame.{' The axis is logarithmic.' if log else ''}"
               f"{_LOST if any(line.lost for line in lines) else ''}")
    return drawn(figure, title, caption, f"{title}: {what} in pixels over time in seconds, a line for each method.")


def _mark_lost(axes: Axes, lines: Sequence[_Line]) -> None:
    """Draws a row of ticks for each method with lost frames."""
    losers = [(line, color) for line, color in zip(lines, _COLORS, strict=False) if line.lost]
    for row, (line, color) in enumerate(losers):
        axes.plot(line.lost, [0.02 + _TICK * row] * len(line.lost), "|", color=color, markersize=7, markeredgewidth=1.5,
                  transform=axes.get_xaxis_transform())


def _scale(axes: Axes, known: Sequence[float]) -> bool:
    """Sets the same scale for all methods; returns whether it is logarithmic."""
    above = [value for value in known if value > 0]
    if above and max(above) > _WIDE * min(above):
        logarithmic(axes, "y", 0.7 * min(above), 1.4 * max(above))
        return True
    axes.set_ylim(0, 1.08 * max(above, default=1.0))
    return False
