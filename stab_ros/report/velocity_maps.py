"""Figures of velocities on the water plane, over the orthophoto of the first frame."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from stab_ros.core.text import counted
from stab_ros.core.types import FloatArray, Gray
from stab_ros.report.panel import Panel, drawn, label, new_axes, picture_height_in
from stab_ros.velocimetry.grid import VelocityGrid
from stab_ros.velocimetry.speeds import speed_m_s
from stab_ros.velocimetry.vectors import Unit, Vectors

_MOST_PX = 1600  # longer side of the background
_MOST_LINES = 20_000  # trajectories that are drawn
_COLOURS = "turbo"
_HIGH = 99.0  # percentile of speed at the end of the scale
_BINS = 60


@dataclass(frozen=True, eq=False)
class Background:
    """A picture of the plane.

    Attributes:
        gray: (h, w) uint8.
        borders: left, right, bottom and top on the plane.
    """

    gray: Gray
    borders: tuple[float, float, float, float]


def trajectory_panel(vectors: Vectors, background: Background | None) -> Panel:
    """Trajectories coloured by speed."""
    figure, axes = _plane(background, vectors.unit)
    chosen = vectors[:: -(-len(vectors) // _MOST_LINES)]
    speed = speed_m_s(chosen)
    lines = LineCollection(list(np.stack([chosen.start_m, chosen.end_m], axis=1)), array=speed, cmap=_COLOURS,
                           linewidths=0.8)
    lines.set_clim(0, _top(speed))
    axes.add_collection(lines)
    figure.colorbar(lines, ax=axes, label=f"speed, {vectors.unit}/s", shrink=0.8)
    _fit(axes, background, vectors)
    return drawn(figure, "Trajectories", f"{len(chosen)} of {counted(len(vectors), 'vector')}, each from its start "
                 "to its end, "
                 "coloured by speed.", "Coloured lines over the orthophoto: where and how fast the surface moved.",
                 photo=True)


def histogram_panel(vectors: Vectors) -> Panel:
    """Speeds of all vectors."""
    figure, axes = new_axes()
    speed = speed_m_s(vectors)
    axes.hist(speed, bins=_BINS, range=(0, max(_top(speed), 1e-6)), color="#1f6fb2")
    median = float(np.median(speed))
    axes.axvline(median, color="#c0392b")
    label(axes, f"speed, {vectors.unit}/s", "vectors")
    return drawn(figure, "Speeds", f"{counted(len(vectors), 'vector')}; red: median, {median:.3g} {vectors.unit}/s.",
                 "Histogram of the speeds of all vectors.")


def median_panel(grid: VelocityGrid, background: Background | None, vectors: Vectors) -> Panel:
    """Median velocity of each cell, as arrows on a map of speed."""
    speed = np.hypot(*grid.median_m_s.T)
    figure, axes = _cells(grid, speed, _top(speed), f"median speed, {vectors.unit}/s", background, vectors)
    axes.quiver(*grid.centre_m.T, *(grid.median_m_s / np.where(speed > 0, speed, 1)[:, None]).T, angles="xy",
                scale_units="xy", scale=1.4 / grid.side_m, color="black", width=0.003)
    return drawn(figure, "Median velocity", f"Cells of {grid.side_m:g} {vectors.unit}; arrows: direction.",
                 "A map of the median speed of each cell, with arrows in the direction of the flow.", photo=True)


def sigma_panel(grid: VelocityGrid, background: Background | None, vectors: Vectors) -> Panel:
    """Standard error of each cell."""
    sigma = np.hypot(*grid.sigma_m_s.T)
    figure, axes = _cells(grid, sigma, _top(sigma), f"standard error, {vectors.unit}/s", background, vectors)
    axes.set_axisbelow(True)
    return drawn(figure, "Standard error of the median", "Of the vectors' own errors or their scatter, whichever is "
                 "larger, and of all that they share: camera, water level, homographies.",
                 "A map of the standard error of each cell.", photo=True)


def bank_panel(bank: Vectors) -> Panel:
    """The velocities of single vectors on the bank."""
    figure, axes = new_axes()
    factor, unit = (1000, "mm") if bank.unit == "m" else (1, "px")
    axes.plot(*(factor * bank.velocity_m_s).T, ".", markersize=3, color="#3b8a4d")
    axes.axhline(0, color="black", linewidth=0.8)
    axes.axvline(0, color="black", linewidth=0.8)
    axes.set_aspect("equal", adjustable="datalim")
    label(axes, f"vx, {unit}/s", f"vy, {unit}/s")
    return drawn(figure, "Velocity of the bank", f"{counted(len(bank), 'vector')} on static ground, which should lie "
                 "around 0.",
                 "Points: the two components of each velocity on the bank.")


def _plane(background: Background | None, unit: Unit) -> tuple[Figure, Axes]:
    width, height = (4.0, 3.0) if background is None else background.gray.shape[::-1]
    figure, axes = new_axes(picture_height_in(width, height))
    if background is not None:
        gray = background.gray
        factor = _MOST_PX / max(gray.shape)
        if factor < 1:
            gray = np.asarray(cv2.resize(gray, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA))
        axes.imshow(gray * 0.7, cmap="gray", vmin=0, vmax=255, extent=background.borders)
    axes.grid(False)
    axes.set_aspect("equal")
    label(axes, *(("east, m", "north, m") if unit == "m" else ("x, px", "y, px")))
    return figure, axes


def _cells(grid: VelocityGrid, values: FloatArray, top: float, name: str, background: Background | None,
           vectors: Vectors) -> tuple[Figure, Axes]:
    """Coloured cells over the background."""
    figure, axes = _plane(background, vectors.unit)
    low = grid.centre_m.min(axis=0)
    column, row = np.round((grid.centre_m - low) / grid.side_m).astype(int).T
    table = np.full((row.max() + 1, column.max() + 1), np.nan)
    table[row, column] = values
    (left, bottom), (right, up) = low - grid.side_m / 2, grid.centre_m.max(axis=0) + grid.side_m / 2
    shown = axes.imshow(table, cmap=_COLOURS, vmin=0, vmax=top, alpha=0.75, origin="lower",
                        extent=(left, right, bottom, up))
    figure.colorbar(shown, ax=axes, label=name, shrink=0.8)
    _fit(axes, background, vectors)
    return figure, axes


def _fit(axes: Axes, background: Background | None, vectors: Vectors) -> None:
    """Limits of the axes: those of the background, y down for pixels."""
    if background is not None:
        left, right, bottom, top = background.borders
        axes.set_xlim(left, right)
        axes.set_ylim(bottom, top)
        return
    places = np.concatenate([vectors.start_m, vectors.end_m])
    (left, low), (right, high) = places.min(axis=0), places.max(axis=0)
    axes.set_xlim(left, right)
    axes.set_ylim(*((high, low) if vectors.unit == "px" else (low, high)))


def _top(values: FloatArray) -> float:
    return max(float(np.percentile(values, _HIGH)), 1e-9) if len(values) else 1.0
