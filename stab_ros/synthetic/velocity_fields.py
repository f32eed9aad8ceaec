"""Surface velocities of rivers as functions of place and time, in the map (x east, y north), without a source or sink.

A flow that neither starts nor ends anywhere keeps floating particles as dense as they are, so the density of what
drifts says nothing of the velocity. All fields but `Uniform` are derived from a stream function psi:
u = d psi / dy, v = -d psi / dx (Batchelor 1967, section 2.2).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from stab_ros.core.errors import InputError
from stab_ros.core.types import FloatArray
from stab_ros.synthetic.channel import Channel


class VelocityField(Protocol):
    """The velocity of the water surface."""

    def velocity_m_s(self, points_m: FloatArray, time_s: float) -> FloatArray:
        """Velocity at points of the map.

        Args:
            points_m: (N, 2) east and north.
            time_s: since frame 0; may be negative.

        Returns:
            (N, 2) to the east and to the north, m/s.
        """


@dataclass(frozen=True)
class Uniform:
    """The same velocity everywhere and always."""

    east_m_s: float
    north_m_s: float = 0.0

    def velocity_m_s(self, points_m: FloatArray, time_s: float) -> FloatArray:
        return np.tile([self.east_m_s, self.north_m_s], (len(points_m), 1))


@dataclass(frozen=True)
class Profile:
    """Share of the speed on the centre line against the position e across the channel: (1 - |e|^n)(1 + k e).

    Attributes:
        exponent: n; 2 is a parabola, more is flatter in mid-stream.
        skew: k; above 0 the north is faster.

    Raises:
        InputError: an exponent below 1, or a skew beyond -1 and 1, which would flow upstream.
    """

    exponent: float = 2.0
    skew: float = 0.0

    def __post_init__(self) -> None:
        if self.exponent < 1 or abs(self.skew) > 1:
            raise InputError(f"a profile of exponent {self.exponent} and skew {self.skew}, they must be at least 1 and "
                             "between -1 and 1")

    def at(self, across: FloatArray) -> FloatArray:
        """The share (N,) at positions (N,); 0 beyond the banks."""
        e = np.clip(across, -1, 1)
        return np.asarray((1 - np.abs(e) ** self.exponent) * (1 + self.skew * e))

    def integral(self, across: FloatArray) -> FloatArray:
        """Integral (N,) of the share from the centre line to positions (N,)."""
        e, n = np.clip(across, -1, 1), self.exponent
        power = np.abs(e) ** (n + 1)
        return np.asarray(e - np.sign(e) * power / (n + 1) + self.skew * (e * e / 2 - power * np.abs(e) / (n + 2)))


@dataclass(frozen=True)
class ChannelFlow:
    """Flow along a channel and round its islands.

    Without islands, the position across the channel is constant along each path and east grows by speed * share each
    second, which makes every path known in closed form. Each island turns psi into psi_i + (psi - psi_i) s, with psi_i
    at its centre and s = `EllipticIsland.openness`.

    Attributes:
        channel: where it flows.
        speed_m_s: to the east, on the centre line far from islands.
        profile: across the channel.
    """

    channel: Channel
    speed_m_s: float
    profile: Profile = field(default_factory=Profile)

    def velocity_m_s(self, points_m: FloatArray, time_s: float) -> FloatArray:
        across = self.channel.across(points_m)
        east = self.speed_m_s * self.profile.at(across)
        velocity = np.stack([east, east * self.channel.slope(points_m[:, 0])], axis=1)
        if self.channel.islands:
            velocity = np.where(np.abs(across)[:, None] < 1, self._round_islands(points_m, velocity), 0)
        return velocity

    def stream_function(self, points_m: FloatArray) -> FloatArray:
        """Psi (N,), m2/s, at points (N, 2), without islands."""
        return self.speed_m_s * self.channel.half_width_m * self.profile.integral(self.channel.across(points_m))

    def _round_islands(self, points_m: FloatArray, velocity: FloatArray) -> FloatArray:
        psi = self.stream_function(points_m)
        for island in self.channel.islands:
            off = psi - self.stream_function(np.array([island.centre_m]))
            s, gradient = island.openness(points_m), island.openness_gradient(points_m)
            velocity = velocity * s[:, None] + off[:, None] * gradient[:, ::-1] * (1, -1)
            psi = psi + off * (s - 1)
        return velocity


@dataclass(frozen=True)
class Eddy:
    """A vortex with psi = -speed radius exp((1 - r^2 / radius^2) / 2), to be added to a flow.

    Attributes:
        centre_m: east and north.
        radius_m: where it is fastest.
        speed_m_s: there, positive anticlockwise.

    Raises:
        InputError: a radius that is not positive.
    """

    centre_m: tuple[float, float]
    radius_m: float
    speed_m_s: float

    def __post_init__(self) -> None:
        if self.radius_m <= 0:
            raise InputError(f"an eddy with a radius of {self.radius_m} m, it must be positive")

    def velocity_m_s(self, points_m: FloatArray, time_s: float) -> FloatArray:
        away = (points_m - self.centre_m) / self.radius_m
        speed = self.speed_m_s * np.exp((1 - away[:, 0] ** 2 - away[:, 1] ** 2) / 2)
        return np.asarray(speed[:, None] * away[:, ::-1] * (-1, 1))


@dataclass(frozen=True)
class Sum:
    """Several fields added."""

    parts: tuple[VelocityField, ...]

    def velocity_m_s(self, points_m: FloatArray, time_s: float) -> FloatArray:
        total = np.zeros((len(points_m), 2))
        for part in self.parts:
            total += part.velocity_m_s(points_m, time_s)
        return total


@dataclass(frozen=True)
class Surge:
    """The flow faster by `share` (slower if negative) at `time_s`, as a Gaussian of standard deviation `length_s`."""

    time_s: float
    length_s: float
    share: float


@dataclass(frozen=True)
class Unsteady:
    """A field times 1 + share sin(2 pi time / period) + surges.

    Attributes:
        steady: the field.
        share: amplitude of the pulse.
        period_s: of the pulse.
        surges: sudden changes.
    """

    steady: VelocityField
    share: float = 0.0
    period_s: float = 1.0
    surges: tuple[Surge, ...] = ()

    def velocity_m_s(self, points_m: FloatArray, time_s: float) -> FloatArray:
        return self.factor(time_s) * self.steady.velocity_m_s(points_m, time_s)

    def factor(self, time_s: float) -> float:
        """What the steady velocity is multiplied by."""
        pulse = 1 + self.share * math.sin(2 * math.pi * time_s / self.period_s)
        return pulse + sum(s.share * math.exp(-((time_s - s.time_s) / s.length_s) ** 2 / 2) for s in self.surges)
