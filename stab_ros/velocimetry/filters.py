"""Filters of vectors: each tells which to keep, and is known by its name, under which its victims are counted."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from stab_ros.core.types import BoolArray, FloatArray
from stab_ros.velocimetry.local_median import fits_neighbours
from stab_ros.velocimetry.settings import VelocityConfig
from stab_ros.velocimetry.vectors import Vectors

PARTS = 3  # of a track, whose velocities are compared


@dataclass(frozen=True, eq=False)
class Candidates:
    """Vectors before they are filtered.

    Attributes:
        vectors: N of them.
        parts_m_s: (N, 3, 2), velocities in the thirds of each track; NaN where it has fewer steps.
    """

    vectors: Vectors
    parts_m_s: FloatArray

    def __getitem__(self, keep: BoolArray) -> Candidates:
        return Candidates(self.vectors[keep], self.parts_m_s[keep])


@dataclass(frozen=True, eq=False)
class Filtered:
    """What filters have left.

    Attributes:
        vectors: that passed all of them.
        dropped: how many each has dropped, by name, in the order in which they were applied.
    """

    vectors: Vectors
    dropped: Mapping[str, int]


Filter = Callable[[Candidates, VelocityConfig], BoolArray]


def filtered(candidates: Candidates, config: VelocityConfig) -> Filtered:
    """Applies all filters, one after the other, each to what those before it have left."""
    dropped = {}
    for name, keep in FILTERS.items():
        kept = keep(candidates, config)
        dropped[name] = int(np.count_nonzero(~kept))
        candidates = candidates[kept]
    return Filtered(candidates.vectors, MappingProxyType(dropped))


def long_enough(candidates: Candidates, config: VelocityConfig) -> BoolArray:
    """Tracks of at least the share `min_track` of `extract_s`; half a step of 25 frames/s is allowed for."""
    return np.asarray(candidates.vectors.dt_s >= config.min_track * config.extract_s - 0.02)


def steady(candidates: Candidates, config: VelocityConfig) -> BoolArray:
    """Tracks whose velocity changes little between thirds (as FlowVeloTool; Eltner et al. 2020)."""
    if not config.steadiness:
        return np.ones(len(candidates.vectors), bool)
    change = np.linalg.norm(candidates.parts_m_s - candidates.parts_m_s.mean(axis=1, keepdims=True), axis=2).max(axis=1)
    speed = np.linalg.norm(candidates.vectors.velocity_m_s, axis=1)
    noise = 3 * PARTS * _sigma(candidates.vectors)  # a third of the time, so three times the noise; 3 sigma
    return np.asarray(~(change > config.steadiness * speed + noise))  # also keeps tracks too short to tell


def not_too_slow(candidates: Candidates, config: VelocityConfig) -> BoolArray:
    """Speeds of `min_speed` and more."""
    return np.asarray(np.linalg.norm(candidates.vectors.velocity_m_s, axis=1) >= config.min_speed)


def not_too_fast(candidates: Candidates, config: VelocityConfig) -> BoolArray:
    """Speeds up to `max_speed`."""
    limit = config.max_speed or np.inf
    return np.asarray(np.linalg.norm(candidates.vectors.velocity_m_s, axis=1) <= limit)


def downstream(candidates: Candidates, config: VelocityConfig) -> BoolArray:
    """Directions within `direction_tolerance_deg` of `direction_deg`."""
    vx, vy = candidates.vectors.velocity_m_s.T
    off_deg = (np.degrees(np.arctan2(vy, vx)) - config.direction_deg + 180) % 360 - 180
    return np.asarray(np.abs(off_deg) <= config.direction_tolerance_deg)


def sure(candidates: Candidates, config: VelocityConfig) -> BoolArray:
    """Standard errors up to `max_sigma`."""
    return np.asarray(_sigma(candidates.vectors) <= (config.max_sigma or np.inf))


def like_neighbours(candidates: Candidates, config: VelocityConfig) -> BoolArray:
    """Vectors that fit the median of their neighbours."""
    vectors = candidates.vectors
    if not config.local_median:
        return np.ones(len(vectors), bool)
    speed = float(np.median(np.linalg.norm(vectors.velocity_m_s, axis=1))) if len(vectors) else 0.0
    return fits_neighbours(vectors.position_m, vectors.velocity_m_s, _sigma(vectors), config.local_median,
                           config.local_median_eps * speed)


def _sigma(vectors: Vectors) -> FloatArray:
    """(N,) standard error of each vector by itself, along the longer axis."""
    return np.asarray(np.sqrt(np.maximum(np.linalg.eigvalsh(vectors.covariance)[:, -1], 0)))


FILTERS: Mapping[str, Filter] = MappingProxyType({
    "min_track": long_enough, "steadiness": steady, "min_speed": not_too_slow, "max_speed": not_too_fast,
    "direction": downstream, "max_sigma": sure, "local_median": like_neighbours,
})
