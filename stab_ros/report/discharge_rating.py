"""The figure of a rating curve."""

from __future__ import annotations

import numpy as np

from stab_ros.discharge.rating import Rating
from stab_ros.report.panel import PREVIOUS_COLOR, REFERENCE_COLOR, Panel, drawn, label, legend, new_axes

_BEYOND = 0.1  # of the range of stages that is drawn beyond them
_TIMES = 1.96  # standard deviations of a 95 % interval


def rating_panel(rating: Rating) -> Panel:
    """Gaugings, curve and its interval; stage upwards, as hydrologists draw it."""
    stages = np.array([one.stage_m for one in rating.gaugings])
    q = np.array([one.q_m3_s for one in rating.gaugings])
    sigma = np.array([one.sigma_m3_s for one in rating.gaugings])
    beyond = _BEYOND * float(np.ptp(stages))
    h = np.linspace(max(float(stages.min()) - beyond, rating.h0_m), float(stages.max()) + beyond, 200)
    curve, relative = rating.at(h)
    figure, axes = new_axes(4.0)
    axes.fill_betweenx(h, curve * np.exp(-_TIMES * relative), curve * np.exp(_TIMES * relative), color="#d5e4f2",
                       label="95 % interval")
    axes.plot(curve, h, "-", color=REFERENCE_COLOR, linewidth=1.6, label="rating curve")
    axes.errorbar(q, stages, xerr=_TIMES * sigma, fmt="o", color=PREVIOUS_COLOR, markersize=4, capsize=2, linewidth=1.0,
                  label="gaugings, 95 %")
    axes.set_xlim(left=0)
    label(axes, "discharge, m³/s", "stage, m")
    legend(axes, columns=2)
    return drawn(figure, "Rating curve", f"Q = {rating.a:.4g} (h - {rating.h0_m:.4g})^{rating.b:.4g}, fitted to "
                 f"{len(rating.gaugings)} gaugings by least squares of ln Q.",
                 "Stage in metres over discharge in cubic metres a second: gaugings and fitted curve.")
