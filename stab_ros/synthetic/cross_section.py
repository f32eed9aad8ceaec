"""Bed of a moving river and its true discharge through a cross-section."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from stab_ros.core.errors import InputError
from stab_ros.core.types import FloatArray
from stab_ros.synthetic.channel import Channel
from stab_ros.synthetic.velocity_fields import Profile, VelocityField

ALPHA = 0.85  # mean velocity of a vertical by that at the surface (Buchanan and Somers 1969)
_SAMPLES = 20_001
_TIMES = 101


def alpha_of_power_law(exponent: float) -> float:
    """Mean velocity of a vertical by that at the surface, for a velocity that grows with height^(1 / exponent)."""
    return exponent / (exponent + 1)


@dataclass(frozen=True)
class Bed:
    """Bed of a channel: the depth across it follows a profile and vanishes at banks and islands.

    Attributes:
        channel: where the water is.
        depth_m: on the centre line.
        profile: share of that depth across the channel.
        wse_m: water surface elevation.

    Raises:
        InputError: a depth that is not positive.
    """

    channel: Channel
    depth_m: float
    profile: Profile = field(default_factory=Profile)
    wse_m: float = 0.0

    def __post_init__(self) -> None:
        if self.depth_m <= 0:
            raise InputError(f"a bed at a depth of {self.depth_m} m, it must be positive")

    def depths_m(self, points_m: FloatArray) -> FloatArray:
        """Depth (N,) at points (N, 2) of the map; 0 on dry ground."""
        depth = self.depth_m * self.profile.at(self.channel.across(points_m))
        for island in self.channel.islands:
            depth = depth * island.openness(points_m)
        return np.asarray(depth)


@dataclass(frozen=True, eq=False)
class SurveyedSection:
    """A cross-section as surveyed at N points, from the start to the end.

    Attributes:
        chainage_m: (N,) distance from the start.
        points_m: (N, 2) east and north.
        bed_m: (N,) elevation of the ground.
        depth_m: (N,) of the water; 0 on dry ground.
    """

    chainage_m: FloatArray
    points_m: FloatArray
    bed_m: FloatArray
    depth_m: FloatArray


@dataclass(frozen=True)
class CrossSection:
    """A straight section through the water.

    Attributes:
        start_m: east and north of its start, on the left bank (looking downstream).
        end_m: of its end, on the right bank.
        bed: below the water.

    Raises:
        InputError: a section without length.
    """

    start_m: tuple[float, float]
    end_m: tuple[float, float]
    bed: Bed

    def __post_init__(self) -> None:
        if self.length_m == 0:
            raise InputError(f"a cross-section from {self.start_m} to {self.end_m}, it must have a length")

    @staticmethod
    def at(bed: Bed, east_m: float, beyond_m: float = 0.0) -> CrossSection:
        """The section along the north at a place of the channel, and so far beyond its banks."""
        middle = float(bed.channel.centre_north_m(np.array([east_m]))[0])
        reach = bed.channel.half_width_m + beyond_m
        return CrossSection((east_m, middle + reach), (east_m, middle - reach), bed)

    @property
    def length_m(self) -> float:
        """From start to end."""
        return math.dist(self.start_m, self.end_m)

    @property
    def normal(self) -> FloatArray:
        """Unit vector (2,) across the section, downstream: to the left of who walks from start to end."""
        east, north = np.subtract(self.end_m, self.start_m) / self.length_m
        return np.array([-north, east])

    def points_m(self, chainage_m: FloatArray) -> FloatArray:
        """Points (N, 2) of the map at distances (N,) from the start."""
        along = np.subtract(self.end_m, self.start_m) / self.length_m
        return np.asarray(self.start_m + chainage_m[:, None] * along)

    def area_m2(self) -> float:
        """Wetted area."""
        return self._integral(self._depths_m)

    def discharge_m3_s(self, surface: VelocityField, time_s: float = 0.0, alpha: float = ALPHA) -> float:
        """True discharge at an instant, positive downstream: alpha times the integral of depth * surface velocity.

        Args:
            surface: velocity of the water surface.
            time_s: since frame 0.
            alpha: mean velocity of a vertical by that at its surface.
        """
        normal = surface.velocity_m_s(self._points_m, time_s) @ self.normal
        return alpha * self._integral(self._depths_m * normal)

    def mean_discharge_m3_s(self, surface: VelocityField, start_s: float, end_s: float, alpha: float = ALPHA) -> float:
        """True mean discharge over a time, as `discharge_m3_s`."""
        each = [self.discharge_m3_s(surface, t, alpha) for t in np.linspace(start_s, end_s, _TIMES)]
        return (math.fsum(each) - (each[0] + each[-1]) / 2) / (_TIMES - 1)

    def surveyed(self, points: int, seed: int | None = None, noise_m: float = 0.0) -> SurveyedSection:
        """The section as somebody surveys it, both ends included.

        Args:
            points: number of them, at least 2.
            seed: the points are as far apart as it falls out; None: equally far, and without noise.
            noise_m: standard deviation of the measured elevations.

        Raises:
            InputError: fewer than 2 points.
        """
        if points < 2:
            raise InputError(f"a section surveyed at {points} points, there must be at least 2")
        share = np.linspace(0, 1, points)
        error = np.zeros(points)
        if seed is not None:
            rng = np.random.default_rng([seed, 90])
            share[1:-1] += rng.uniform(-0.35, 0.35, points - 2) / (points - 1)
            error = noise_m * rng.standard_normal(points)
        where = self.points_m(share * self.length_m)
        bed = self.bed.wse_m - self.bed.depths_m(where) + error
        return SurveyedSection(share * self.length_m, where, bed, np.maximum(self.bed.wse_m - bed, 0))

    @cached_property
    def _points_m(self) -> FloatArray:
        return self.points_m(np.linspace(0, self.length_m, _SAMPLES))

    @cached_property
    def _depths_m(self) -> FloatArray:
        return self.bed.depths_m(self._points_m)

    def _integral(self, values: FloatArray) -> float:
        """Of values (n,) at `_points_m`, by the trapezoidal rule."""
        return float((values.sum() - (values[0] + values[-1]) / 2) * self.length_m / (_SAMPLES - 1))
