"""Residual motion of the whole image: its path and its spectrum."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from stab_ros.evaluation.results import TopicEvaluation
from stab_ros.evaluation.summary import after_reference, shifts_px
from stab_ros.metrics.spectra import SPLIT_HZ, spectrum
from stab_ros.report.panel import Panel, drawn, label, legend, new_axes, stream_color

_LEAST_HALF_PX = 0.05


def path_panels(topics: Sequence[TopicEvaluation]) -> list[Panel]:
    """One panel for each stream, as their scales differ."""
    return [_path_panel(topic) for topic in topics]


def _path_panel(topic: TopicEvaluation) -> Panel:
    title = f"{topic.topic}: drift path"
    u, v = shifts_px(topic)
    known = np.flatnonzero(np.isfinite(u) & np.isfinite(v))
    if not len(known):
        return Panel(title, "No shift could be measured, so there is no path to draw.")
    figure, axes = new_axes(4.6)
    axes.plot(u[known], v[known], color="#b0b0b0", linewidth=0.7)
    stamps_ns = np.array([row.stamp_ns for row in after_reference(topic)])[known]
    seconds = (stamps_ns - topic.rows[0].stamp_ns) / 1e9
    dots = axes.scatter(u[known], v[known], c=seconds, cmap="viridis", s=14, zorder=3)
    figure.colorbar(dots, ax=axes, shrink=0.8).set_label("time since the first frame, s", fontsize=11)
    axes.plot(0, 0, "+", color="black", markersize=12, markeredgewidth=1.5)
    half = max(_LEAST_HALF_PX, 1.1 * float(np.max(np.abs([u[known], v[known]]))))
    axes.set_xlim(-half, half)
    axes.set_ylim(half, -half)
    axes.set_aspect("equal")
    axes.locator_params(nbins=5)
    label(axes, "shift u to the right, px", "shift v downwards, px")
    return drawn(figure, title, "Where each frame lies against the reference (cross), as the median over the static "
                 "points.", "The shift of every frame in pixels, to the right and downwards, coloured by time.")


def spectrum_panels(topics: Sequence[TopicEvaluation]) -> list[Panel]:
    """One panel with all streams."""
    title = "Spectrum of the residual motion"
    figure, axes = new_axes(3.7 + 0.2 * len(topics))
    found = False
    for index, topic in enumerate(topics):
        if not topic.fps > 0:
            continue
        u, v = (spectrum(series, topic.fps) for series in shifts_px(topic))
        if len(u.frequency_hz) > 1:
            found = True
            axes.loglog(u.frequency_hz[1:], u.density_px2_hz[1:] + v.density_px2_hz[1:], linewidth=1.2,
                        color=stream_color(index), label=topic.topic)
    if not found:
        return [Panel(title, "Too few frames were measured for a spectrum; it takes at least 4.")]
    axes.axvline(SPLIT_HZ, color="#888888", linewidth=0.8, linestyle="--")
    label(axes, "frequency, Hz", "power spectral density, px²/Hz")
    legend(axes)
    return [drawn(figure, title, f"Of the shift in both directions: drift left of the dashed line ({SPLIT_HZ:g} Hz), "
                  "jitter right of it.", "Power spectral density in square pixels per hertz over frequency in hertz.")]
