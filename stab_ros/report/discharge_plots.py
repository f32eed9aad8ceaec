"""Figures of a discharge: the section, its velocities and partial discharges, the plan, the draws and their sources."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes

from stab_ros.core.text import counted
from stab_ros.discharge.result import Discharge
from stab_ros.report.panel import PREVIOUS_COLOR, REFERENCE_COLOR, Panel, drawn, label, legend, new_axes
from stab_ros.velocimetry.vectors import Vectors

_BED, _WATER = "#7a5c3a", "#cfe3f5"
_MOST_ARROWS = 400
_ARROWS_IN = 1.2  # length of the arrow of the fastest vector over the spacing of verticals
_BARS = 40


def section_panels(found: Discharge, alpha: float) -> list[Panel]:
    """Bed and surface, surface velocities with their error bars, and partial discharges, over one axis."""
    return [_bed(found), _velocities(found, alpha), _parts(found)]


def _bed(found: Discharge) -> Panel:
    table = found.verticals
    figure, axes = new_axes(3.2)
    axes.fill_between(table.chainage_m, np.minimum(table.bed_m, found.wse_m), found.wse_m, color=_WATER)
    axes.plot(table.chainage_m, table.bed_m, "-", color=_BED, linewidth=1.6)
    for which, color, name in ((table.measured, REFERENCE_COLOR, "measured"),
                               (table.wet & ~table.measured, PREVIOUS_COLOR, "filled")):
        axes.plot(table.chainage_m[which], table.bed_m[which], "o", color=color, markersize=4, label=name)
    axes.axhline(found.wse_m, color=REFERENCE_COLOR, linewidth=1.0)
    label(axes, "chainage, m", "elevation, m")
    legend(axes, columns=2)
    return drawn(figure, "Cross-section", f"Bed and water surface at {found.wse_m:.6g} m; the chainage runs from left "
                 "to right.", "Bed elevation in metres over chainage in metres, with the water surface and the "
                 "verticals.")


def _velocities(found: Discharge, alpha: float) -> Panel:
    table = found.verticals
    figure, axes = new_axes(3.4)
    measured, filled = table.measured, table.wet & ~table.measured
    axes.errorbar(table.chainage_m[measured], table.surface_m_s[measured], 2 * table.sigma_m_s[measured], fmt="o",
                  color=REFERENCE_COLOR, markersize=4, capsize=2, linewidth=1.0, label="measured, ± 2 sigma")
    axes.plot(table.chainage_m[filled], table.surface_m_s[filled], "D", color=PREVIOUS_COLOR, markersize=4,
              label="filled")
    axes.plot(table.chainage_m[table.wet], alpha * table.surface_m_s[table.wet], "-", color="#707070", linewidth=1.0,
              label=f"depth-averaged, {alpha:g} of it")
    label(axes, "chainage, m", "velocity, m/s")
    legend(axes, columns=2)
    return drawn(figure, "Surface velocity", "Component across the section, positive downstream: the median of the "
                 f"vectors within {found.search_m:.3g} m of each vertical.", "Surface velocity in metres a second over "
                 "chainage in metres, with error bars.")


def _parts(found: Discharge) -> Panel:
    table = found.verticals
    figure, axes = new_axes(3.0)
    width_m = 0.8 * float(np.median(np.diff(table.chainage_m))) if len(table.chainage_m) > 1 else 1.0
    for which, color, name in ((table.measured, REFERENCE_COLOR, "measured"),
                               (table.wet & ~table.measured, PREVIOUS_COLOR, "filled")):
        if which.any():
            axes.bar(table.chainage_m[which], table.part_m3_s[which], width_m, color=color, label=name)
    label(axes, "chainage, m", "partial discharge, m³/s")
    legend(axes, columns=2)
    return drawn(figure, "Partial discharges", "What each vertical brings; their sum is the discharge.",
                 "Bars of partial discharge in cubic metres a second over chainage in metres.")


def plan_panel(found: Discharge, vectors: Vectors) -> Panel:
    """Section and vectors in the map."""
    figure, axes = new_axes(4.2)
    step = max(len(vectors) // _MOST_ARROWS, 1)
    some = vectors[::step]
    velocity = some.velocity_m_s
    speed = np.hypot(*velocity.T)
    scale = max(float(speed.max()), 1e-9) / (_ARROWS_IN * 2 * found.search_m)
    drawn_as = axes.quiver(*some.start_m.T, *velocity.T, speed, angles="xy", scale_units="xy", scale=scale,
                           cmap="viridis", width=0.004)
    figure.colorbar(drawn_as, ax=axes, label="m/s")
    table = found.verticals
    axes.plot(*table.position_m.T, "-", color=_BED, linewidth=1.4)
    axes.plot(*table.position_m[table.measured].T, "o", color=REFERENCE_COLOR, markersize=4)
    axes.plot(*table.position_m[table.wet & ~table.measured].T, "o", color=PREVIOUS_COLOR, markersize=4)
    _arrow_downstream(axes, found)
    axes.set_aspect("equal", adjustable="datalim")
    label(axes, "east, m", "north, m")
    return drawn(figure, "Plan", f"{len(some)} of {counted(len(vectors), 'vector')}, and the section with its "
                 "verticals: blue measured, orange filled. The black arrow points downstream, across the section.",
                 "Map of the section and of velocity vectors, east and north in metres.")


def _arrow_downstream(axes: Axes, found: Discharge) -> None:
    middle = found.verticals.position_m[found.verticals.wet].mean(axis=0)
    axes.annotate("", middle + 0.25 * found.width_m * found.downstream, middle,
                  arrowprops={"arrowstyle": "-|>", "color": "black", "linewidth": 1.5})


def draws_panel(found: Discharge) -> Panel:
    """Histogram of the Monte Carlo."""
    figure, axes = new_axes(3.0)
    axes.hist(found.drawn_m3_s, _BARS, color="#a9c4de")
    axes.axvline(found.q_m3_s, color=REFERENCE_COLOR, linewidth=1.8, label="discharge")
    for bound, name in ((found.low_m3_s, "95 % interval"), (found.high_m3_s, None)):
        axes.axvline(bound, color=PREVIOUS_COLOR, linewidth=1.4, linestyle="--", label=name)
    label(axes, "discharge, m³/s", "draws")
    legend(axes, columns=2)
    return drawn(figure, "Monte Carlo", f"{len(found.drawn_m3_s)} draws of alpha, water level, bed, vectors, the "
                 "errors that all vectors share, the filling, and the number of verticals where it is small.",
                 "Histogram of the drawn discharges.")


def sources_panel(found: Discharge) -> Panel:
    """What each source alone makes of the standard deviation."""
    figure, axes = new_axes(2.8)
    names = list(found.sources_m3_s)
    shares = [100 * found.sources_m3_s[name] / max(abs(found.q_m3_s), 1e-12) for name in names]
    axes.barh(names[::-1], shares[::-1], color="#7fa8cf")
    label(axes, "standard deviation, % of the discharge", "")
    return drawn(figure, "Where the uncertainty comes from", "Standard deviation of the discharge by each source "
                 "alone; their squares add up to that of all.", "Bars of the standard deviation by source, in percent.")
