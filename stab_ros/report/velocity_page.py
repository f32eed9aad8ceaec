"""The report of `stab-ros velocity`: what was measured, how sure it is, and whether the bank stands still."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from stab_ros.core.errors import WorkError
from stab_ros.report.panel import Panel, Section
from stab_ros.report.rendering import rendered
from stab_ros.report.velocity_maps import (
    Background,
    bank_panel,
    histogram_panel,
    median_panel,
    sigma_panel,
    trajectory_panel,
)
from stab_ros.velocimetry.bank import BankVelocity
from stab_ros.velocimetry.bank_over_time import told
from stab_ros.velocimetry.dropped import dropped_text
from stab_ros.velocimetry.grid import on_grid
from stab_ros.velocimetry.grid_side import side_for
from stab_ros.velocimetry.speeds import sigma_speed_m_s, speed_m_s
from stab_ros.velocimetry.vectors import Vectors


@dataclass(frozen=True, eq=False)
class Measurement:
    """What the page tells.

    Attributes:
        source: name of the recording.
        vectors: of the water.
        bank: velocity of static ground.
        bank_vectors: of static ground.
        background: picture of the plane; None: there is none.
        bank_known: whether a static map tells where the bank is.
        frames: number of frames.
        placed: number of those that were placed.
        warnings: one line each.
        grid_m: side of the cells; 0: what suits the vectors.
        dropped: how many vectors filters have dropped, by reason.
    """

    source: str
    vectors: Vectors
    bank: BankVelocity
    bank_vectors: Vectors
    background: Background | None
    bank_known: bool
    frames: int
    placed: int
    warnings: tuple[str, ...]
    grid_m: float = 0.0
    dropped: Mapping[str, int] = field(default_factory=dict)


def write_velocity_page(path: Path, measurement: Measurement) -> None:
    """Writes the page, one file with all figures in it.

    Raises:
        WorkError: it cannot be written.
    """
    text = rendered("velocity.html", source=measurement.source, rows=list(_rows(measurement)),
                    verdict=bank_verdict(measurement), at_rest=measurement.bank.at_rest, warnings=measurement.warnings,
                    sections=list(_sections(measurement)))
    try:
        path.write_text(text, encoding="utf-8", errors="replace")
    except OSError as error:
        raise WorkError(f"{path}: {error.strerror}") from error


def bank_verdict(measurement: Measurement) -> str:
    """What the bank tells of the velocities, in one sentence."""
    bank = measurement.bank
    if not bank.count:
        return ("The bank of the static map shows too little to tell whether it stands still." if measurement.bank_known
                else "No static map tells where the bank is, so nothing shows that the frames lie still.")
    wrong = "" if bank.at_rest else " The frames do not lie still, and all velocities are wrong by as much."
    return f"The bank moves by {told(bank, measurement.vectors.unit)}.{wrong}"


def _rows(measurement: Measurement) -> Iterator[tuple[str, str]]:
    """Names and values of the table."""
    vectors, unit = measurement.vectors, measurement.vectors.unit
    yield "frames placed", f"{measurement.placed} of {measurement.frames}"
    yield "vectors", f"{len(vectors)}"
    if measurement.dropped:
        yield "vectors dropped", dropped_text(measurement.dropped)
    if not len(vectors):
        return
    speed = speed_m_s(vectors)
    yield "median speed", f"{np.median(speed):.4g} {unit}/s"
    yield "5 % and 95 % of speeds", f"{np.percentile(speed, 5):.4g} and {np.percentile(speed, 95):.4g} {unit}/s"
    vx, vy = np.median(vectors.velocity_m_s, axis=0)
    yield "median velocity", f"({vx:.4g}, {vy:.4g}) {unit}/s"
    yield "median standard deviation of a vector", f"{np.median(sigma_speed_m_s(vectors)):.2g} {unit}/s"
    yield "duration of a vector", f"{np.median(vectors.dt_s):.3g} s"


def _sections(measurement: Measurement) -> Iterator[Section]:
    vectors, background = measurement.vectors, measurement.background
    if not len(vectors):
        yield Section("vectors", "Velocities", [Panel("Trajectories", "No vector was measured.")])
    else:
        grid = on_grid(vectors, measurement.grid_m or side_for(vectors))
        yield Section("vectors", "Velocities", [trajectory_panel(vectors, background), histogram_panel(vectors)])
        yield Section("grid", "On a grid", [median_panel(grid, background, vectors),
                                            sigma_panel(grid, background, vectors)])
    if len(measurement.bank_vectors):
        yield Section("bank", "The bank", [bank_panel(measurement.bank_vectors)])
