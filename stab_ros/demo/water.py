"""The known motion of the water of the sample, and the made-up cross-section through it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.interpolate import RegularGridInterpolator

from stab_ros.core.errors import InputError
from stab_ros.core.types import FloatArray

# across the left part of the picture, upstream of the island, on both banks to the land: places in the map, m
SECTION_FROM_M, SECTION_TO_M = np.array([-16.0, -11.5]), np.array([-16.0, 13.5])
_POINTS = 26
_DEEPEST_M, _DEEPEST_AT, _BANK_M = 1.4, 0.55, 0.05  # the bed: deepest at this share of the way; above water at the ends
_STEPS = 4000  # of the integration


@dataclass(frozen=True)
class KnownWater:
    """The water of the sample as the renderer moves it.

    Attributes:
        velocity: of places (n, 2) in px of the reference, x and y: m/s to the right and down (n, 2), NaN outside.
        gsd_m: of the reference, m.
        size: its width and height, px.
    """

    velocity: RegularGridInterpolator
    gsd_m: float
    size: tuple[int, int]

    def velocity_m_s(self, position_m: FloatArray) -> FloatArray:
        """Velocity (n, 2), m/s, east and north, at places (n, 2) in the map of a reference that looks straight down."""
        return np.asarray(self.velocity(self.pixels(position_m)) * (1, -1))

    def pixels(self, position_m: FloatArray) -> FloatArray:
        """Places (n, 2) of the map in the reference, px."""
        centre_px = (np.array(self.size) - 1) / 2
        return np.asarray(centre_px + position_m / self.gsd_m * (1, -1))

    def discharge_m3_s(self, alpha: float) -> float:
        """The discharge through the cross-section: the integral of depth times velocity across, times alpha."""
        share = (np.arange(_STEPS) + 0.5) / _STEPS
        way_m = SECTION_TO_M - SECTION_FROM_M
        velocity = self.velocity_m_s(SECTION_FROM_M + share[:, None] * way_m)
        across = velocity @ np.array([way_m[1], -way_m[0]]) / _STEPS  # times the length of a step
        return float(alpha * np.sum(across * np.maximum(depth_m(share), 0)))


def read_water(path: Path, gsd_m: float, size: tuple[int, int]) -> KnownWater:
    """Reads sample_water.csv.

    Raises:
        InputError: it is unreadable.
    """
    try:
        table = np.loadtxt(path, delimiter=",", skiprows=1, ndmin=2)
        x_px, y_px = np.unique(table[:, 0]), np.unique(table[:, 1])
        flow = table[:, 2:4].reshape(len(y_px), len(x_px), 2).transpose(1, 0, 2)
        velocity = RegularGridInterpolator((x_px, y_px), flow, bounds_error=False)
    except (OSError, ValueError, IndexError) as error:
        raise InputError(f"{path}: holds no table of velocities ({error}); `git checkout` brings it back") from error
    return KnownWater(velocity, gsd_m, size)


def depth_m(share: FloatArray) -> FloatArray:
    """Depth (n,) of the made-up bed at shares (n,) of the way across: two half parabolas, below 0 on land."""
    side = np.where(share < _DEEPEST_AT, _DEEPEST_AT, 1 - _DEEPEST_AT)
    return np.asarray((_DEEPEST_M + _BANK_M) * (1 - ((share - _DEEPEST_AT) / side) ** 2) - _BANK_M)


def write_section(path: Path) -> None:
    """Writes the survey of the cross-section, in the map, as depths."""
    share = np.linspace(0, 1, _POINTS)
    places = SECTION_FROM_M + share[:, None] * (SECTION_TO_M - SECTION_FROM_M)
    rows = [f"{x:.3f},{y:.3f},{depth:.3f}" for (x, y), depth in zip(places, depth_m(share), strict=True)]
    path.write_text("\n".join(["X,Y,depth", *rows]) + "\n", encoding="utf-8")
