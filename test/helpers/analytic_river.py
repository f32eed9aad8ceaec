"""Rivers whose discharge is known: bed and surface velocity as functions of the place across the river."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from stab_ros.core.types import FloatArray
from stab_ros.discharge.cross_section import CrossSection, between
from stab_ros.velocimetry.vectors import Vectors

WIDTH_M, DEPTH_M, SPEED_M_S, WSE_M, ALPHA = 20.0, 1.5, 1.2, 10.0, 0.85
_FINE = 20001
_NS = 1_000_000_000


def parabola_m(s: FloatArray) -> FloatArray:
    """Depth of a parabolic bed; negative beyond the shores at 0 and WIDTH_M."""
    return np.asarray(DEPTH_M * (1 - (2 * s / WIDTH_M - 1) ** 2))


def _relative(s: FloatArray) -> FloatArray:
    return np.asarray(np.maximum(parabola_m(s), 0) / DEPTH_M)


PROFILES: Mapping[str, Callable[[FloatArray], FloatArray]] = {  # surface velocity over the place across
    "froude": lambda s: SPEED_M_S * np.sqrt(_relative(s)),
    "asymmetric": lambda s: SPEED_M_S * np.sqrt(_relative(s)) * (1 + 0.3 * (2 * s / WIDTH_M - 1)),
    "manning": lambda s: SPEED_M_S * _relative(s) ** (2 / 3),
    "parabolic": lambda s: SPEED_M_S * _relative(s),
}


@dataclass(frozen=True)
class River:
    """A straight river that flows east; the section runs north from (0, 0).

    depth_m, speed_m_s: of the place across, m.
    """

    speed_m_s: Callable[[FloatArray], FloatArray]
    depth_m: Callable[[FloatArray], FloatArray] = parabola_m

    def discharge_m3_s(self, alpha: float = ALPHA) -> float:
        """The truth."""
        s = np.linspace(0, WIDTH_M, _FINE)
        q = self.speed_m_s(s) * np.maximum(self.depth_m(s), 0)
        return float(alpha * ((q[1:] + q[:-1]) / 2).sum() * (s[1] - s[0]))

    def section(self, verticals: int = 25, noise_m: float = 0.0, rng: np.random.Generator | None = None
                ) -> CrossSection:
        """A survey of it, with a point on each bank."""
        s = np.concatenate([[-1.0], np.linspace(0, WIDTH_M, verticals), [WIDTH_M + 1]])
        bed = WSE_M - self.depth_m(s)
        bed = bed if rng is None else bed + rng.normal(0, noise_m, len(s))
        return between(np.zeros(2), np.array([0.0, 1.0]), s, bed)

    def vectors(self, rng: np.random.Generator, count: int = 1500, until_m: float = WIDTH_M, sigma_m_s: float = 0.1,
                shared: float = 0.01, turn_rad: float = 0.0, start_s: float = 0.0) -> Vectors:
        """Vectors around the section up to a place across, with noise of their own and an error of scale for all."""
        at = np.column_stack([rng.uniform(-2, 2, count), rng.uniform(0, until_m, count)])
        true = np.column_stack([self.speed_m_s(at[:, 1]), np.zeros(count)])
        common = np.stack([shared * true, np.zeros_like(true)], axis=2)
        seen = true + common @ rng.normal(size=2) + rng.normal(0, sigma_m_s, (count, 2))
        c, s = np.cos(turn_rad), np.sin(turn_rad)
        seen = seen @ np.array([[c, s], [-s, c]])
        start = np.full(count, round(start_s * _NS), np.int64)
        covariance = np.tile(np.eye(2) * sigma_m_s**2, (count, 1, 1))
        return Vectors(at - seen / 2, at + seen / 2, start, start + _NS, covariance, common,
                       np.arange(count, dtype=np.int64))
