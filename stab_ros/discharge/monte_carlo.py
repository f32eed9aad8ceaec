"""Monte Carlo over all that makes a discharge uncertain.

A draw takes one alpha, one water level, one value of every error that all vectors share and one error of filling on
each side for the whole section, and for each vertical a velocity and a bed height of its own. So errors that are shared
do not average out over the verticals, and those of single verticals do.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from stab_ros.core.types import FloatArray, IdArray
from stab_ros.discharge.filling import FILLINGS
from stab_ros.discharge.integration import INTEGRATIONS
from stab_ros.discharge.measured import Measured
from stab_ros.discharge.settings import DischargeConfig

_LEAST_ALPHA = 0.05
_OF_THE_CHOSEN = 0.5  # share of draws with the filling that was chosen; the others share the rest
_OF_SEVERAL = "kriging"  # weighs several profiles by itself, and their difference is part of its sigma


@dataclass(frozen=True, eq=False)
class Noise:
    """Standard deviations; 0: none.

    Attributes:
        alpha: of the ratio of depth-averaged to surface velocity.
        wse_m: of the water surface elevation.
        bed_m: of the bed at each vertical.
        velocity_m_s: (N,), of the velocity at each vertical by itself.
        shared_m_s: (N, K), change of the velocities by one standard deviation of each shared error.
        filling_m_s: (N,), of filled velocities, which err together on each side of the measured ones; where any is
            above 0, the way of filling is drawn too, unless it is kriging.
        verticals: of the discharge, relative, by the number of verticals.
    """

    alpha: float
    wse_m: float
    bed_m: float
    velocity_m_s: FloatArray
    shared_m_s: FloatArray
    filling_m_s: FloatArray
    verticals: float

    def only(self, source: str) -> Noise:
        """That of one source of SOURCES alone."""
        keep = SOURCES[source]
        still = np.zeros_like(self.velocity_m_s)
        quiet = Noise(0.0, 0.0, 0.0, still, np.zeros_like(self.shared_m_s), still, 0.0)
        return replace(quiet, **{keep: getattr(self, keep)})


SOURCES: Mapping[str, str] = MappingProxyType({  # name in results: field of Noise
    "alpha": "alpha", "water level": "wse_m", "bed": "bed_m", "vectors": "velocity_m_s", "shared": "shared_m_s",
    "filling": "filling_m_s", "verticals": "verticals"})


def discharges(measured: Measured, velocity_m_s: FloatArray, noise: Noise, config: DischargeConfig) -> FloatArray:
    """Draws of the discharge.

    Args:
        measured: verticals with nominal depths.
        velocity_m_s: (N,), surface velocities; what stands at unknown verticals does not count.
        noise: what is drawn.
        config: alpha, methods, number of draws and seed.

    Returns:
        (draws,), m3/s.
    """
    rng, shape = np.random.default_rng(config.seed), (config.draws, len(velocity_m_s))
    alpha = np.maximum(rng.normal(config.alpha, noise.alpha, (shape[0], 1)), _LEAST_ALPHA)
    depth = measured.depth_m + rng.normal(0.0, noise.wse_m, (shape[0], 1)) + rng.normal(0.0, noise.bed_m, shape)
    common = rng.normal(size=(shape[0], noise.shared_m_s.shape[1])) @ noise.shared_m_s.T
    surface = velocity_m_s + common + rng.normal(size=shape) * noise.velocity_m_s
    filled = _filled(measured, depth, surface, _methods(config, noise, rng))
    filled = filled + noise.filling_m_s * rng.normal(size=(shape[0], 2))[:, _side(measured)]
    total = INTEGRATIONS[config.integration](measured.chainage_m, depth, alpha * filled).sum(axis=1)
    return np.asarray(total * rng.normal(1.0, noise.verticals, shape[0]))


def _methods(config: DischargeConfig, noise: Noise, rng: np.random.Generator) -> IdArray:
    """(draws,), the place in FILLINGS of the method of each draw."""
    names = list(FILLINGS)
    chosen = names.index(config.filling)
    shares = np.full(len(names), (1 - _OF_THE_CHOSEN) / (len(names) - 1))
    shares[chosen] = _OF_THE_CHOSEN
    drawn = rng.choice(len(names), config.draws, p=shares)
    differ = noise.filling_m_s.any() and config.filling != _OF_SEVERAL
    return np.asarray(drawn if differ else np.full(config.draws, chosen), np.int64)


def _side(measured: Measured) -> IdArray:
    """(N,), 0 or 1 for what lies before or after the middle of the measured verticals: each errs as a whole."""
    known = measured.chainage_m[measured.known]
    return np.asarray(measured.chainage_m > (known[0] + known[-1]) / 2, np.int64)


def _filled(measured: Measured, depth_m: FloatArray, velocity_m_s: FloatArray, methods: IdArray) -> FloatArray:
    if measured.known[measured.depth_m > 0].all() and (measured.depth_m > 0).all():
        return velocity_m_s
    filled = np.empty_like(velocity_m_s)
    for at, fill in enumerate(FILLINGS.values()):
        rows = methods == at
        if rows.any():
            filled[rows] = fill(measured, depth_m[rows], velocity_m_s[rows])
    return filled


def sources(measured: Measured, velocity_m_s: FloatArray, noise: Noise, config: DischargeConfig) -> dict[str, float]:
    """The standard deviation that each source alone gives the discharge, m3/s."""
    return {name: float(discharges(measured, velocity_m_s, noise.only(name), config).std()) for name in SOURCES}


def interval(drawn_m3_s: FloatArray) -> tuple[float, float]:
    """The bounds between which 95 % of the draws lie, m3/s."""
    low, high = np.quantile(drawn_m3_s, (0.025, 0.975))
    return float(low), float(high)
