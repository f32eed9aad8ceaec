"""The d(RMSD) fit of every verification point: Eq. 3 of Ljubicic et al. 2021."""

from __future__ import annotations

from collections.abc import Sequence

import matplotlib
import numpy as np

from stab_ros.evaluation.results import TopicEvaluation
from stab_ros.metrics.calibration import FIT_TO_PX
from stab_ros.report.numbers import shown
from stab_ros.report.panel import Panel, drawn, label, legend, new_axes

_COLORS = "tab20"
_NAMED = 24  # largest number of points with a legend


def calibration_panels(topics: Sequence[TopicEvaluation]) -> list[Panel]:
    """One panel for each distinct reference."""
    shown = {tuple(point.calibration for point in topic.points): topic for topic in topics}
    return [_panel(topic) for topic in shown.values()]


def _panel(topic: TopicEvaluation) -> Panel:
    title = f"{topic.topic}: displacement by RMSD"
    if not topic.points:
        return Panel(title, "There is no verification point, so nothing was calibrated.")
    named = len(topic.points) <= _NAMED
    figure, axes = new_axes(3.6 + (0.11 * len(topic.points) if named else 0.0))
    colors = matplotlib.colormaps[_COLORS](np.arange(len(topic.points)) % 20)
    for point, color in zip(topic.points, colors, strict=True):
        fit, curve = point.calibration, point.curve
        axes.plot(curve.rmsd, curve.shift_px, ".", color=color, markersize=5)
        rmsd = np.linspace(0, curve.rmsd.max(), 200)
        within = fit.a * rmsd**2 + fit.b * rmsd <= fit.range_px
        axes.plot(rmsd[within], fit.displacement_px(rmsd[within]), color=color, linewidth=1.3,
                  label=f"{point.name}: R² {shown(fit.r2)}")
        axes.plot(fit.range_rmsd, fit.range_px, "_", color=color, markersize=12, markeredgewidth=2)
    axes.axhline(FIT_TO_PX, color="#888888", linewidth=0.8, linestyle="--")
    axes.set_xlim(left=0)
    axes.set_ylim(bottom=0)
    label(axes, "RMSD, grey levels", "displacement, px")
    if named:
        legend(axes, columns=2)
    return drawn(figure, title, "Dots: the RMSD that the reference has against itself, shifted by known amounts, mean "
                 f"over eight directions. Lines: d = a RMSD² + b RMSD, fitted up to {FIT_TO_PX:g} px (dashed). Bars: "
                 "the range, beyond which no displacement can be measured. The table has a, b and R² of each point.",
                 "Displacement in pixels over RMSD in grey levels: measured points and fitted polynomials.")
