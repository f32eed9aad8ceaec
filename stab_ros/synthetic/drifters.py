"""Particles that drift with a velocity field and are evenly spread, at any time.

Each lives for a time, fades in and out, and is born anywhere in the region, as likely at one place as at another. They
are born in cohorts, one after another. In a flow without sources and sinks they are then as dense everywhere and at all
times, except where water enters the region: the region must begin so far upstream that the water in view has been in it
for a lifetime.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from stab_ros.core.types import BoolArray, FloatArray, IdArray
from stab_ros.synthetic.advection import Paths
from stab_ros.synthetic.velocity_fields import VelocityField

COHORTS = 6  # that live at the same time; the sum of their weights is constant
_PLASTIC = 1.32471795724474602596  # the root of x^3 = x + 1: the sequence spreads evenly in two dimensions
_TRAITS = 2


@dataclass(frozen=True)
class Region:
    """A rectangle of the map: its south-west and north-east corner, m."""

    low_m: tuple[float, float]
    high_m: tuple[float, float]

    @property
    def area_m2(self) -> float:
        """Its area."""
        return (self.high_m[0] - self.low_m[0]) * (self.high_m[1] - self.low_m[1])

    def widened(self, low_by_m: FloatArray, high_by_m: FloatArray) -> Region:
        """The rectangle with margins (2,) at its low and its high sides."""
        low, high = np.array(self.low_m) - low_by_m, np.array(self.high_m) + high_by_m
        return Region((float(low[0]), float(low[1])), (float(high[0]), float(high[1])))

    def grid(self, side: int) -> FloatArray:
        """Points (side * side, 2) all over it, its corners included."""
        east, north = (np.linspace(low, high, side) for low, high in zip(self.low_m, self.high_m, strict=True))
        return np.array(np.meshgrid(east, north)).reshape(2, -1).T


@dataclass(frozen=True, eq=False)
class Drifting:
    """N particles at one instant.

    Attributes:
        place_m: (N, 2) east and north.
        deformation: (N, 2, 2), turns offsets at birth into offsets now: the water around a particle is strained.
        weight: (N,) of its fading, from 0 to 1; the mean over a life is 1/2.
        traits: (N, 2), random numbers from 0 to 1 that stay with a particle.
        number: (N,) int64, unique in a flight.
    """

    place_m: FloatArray
    deformation: FloatArray
    weight: FloatArray
    traits: FloatArray
    number: IdArray


class Drifters:
    """A population of particles.

    Args:
        field: the velocity.
        region: where they are born.
        per_m2: number of those alive, weighted by their fading.
        life_s: from birth to end.
        key: seed of all random numbers.
        arm_m: distance over which the deformation is measured.
        step_s: of the integration of their paths.
        born_at: which of the places (N, 2) are taken at a time: (N,) bool; None: all.
    """

    def __init__(self, field: VelocityField, region: Region, per_m2: float, life_s: float, key: list[int],
                 arm_m: float, step_s: float, born_at: Callable[[FloatArray, float], BoolArray] | None = None) -> None:
        self._field, self._region, self._life_s, self._key, self._arm_m = field, region, life_s, key, arm_m
        self._step_s, self._born_at = step_s, born_at
        self._in_cohort = 2 * per_m2 * region.area_m2 / COHORTS
        self._alive: dict[int, _Cohort] = {}

    def at(self, time_s: float) -> Drifting:
        """The particles alive at a time; the same for the same time, whatever was asked before."""
        period_s = self._life_s / COHORTS
        youngest = math.floor(time_s / period_s)
        numbers = range(youngest - COHORTS + 1, youngest + 1)
        self._alive = {k: self._alive.get(k) or self._born(k, k * period_s) for k in numbers}
        parts = [cohort.at(time_s, self._life_s) for cohort in self._alive.values()]
        return Drifting(*(np.concatenate([getattr(part, name) for part in parts])
                          for name in ("place_m", "deformation", "weight", "traits", "number")))

    def _born(self, cohort: int, time_s: float) -> _Cohort:
        rng = np.random.default_rng([*self._key, cohort % 2**32])
        n = int(self._in_cohort + rng.random())
        places_m, traits = self._spread(rng, n), rng.random((n, _TRAITS))
        number = cohort * 2**32 + np.arange(n, dtype=np.int64)
        keep = slice(None) if self._born_at is None else self._born_at(places_m, time_s)
        paths = Paths(self._field, _with_arms(places_m[keep], self._arm_m), time_s, self._step_s)
        return _Cohort(paths, traits[keep], number[keep], time_s, self._arm_m)

    def _spread(self, rng: np.random.Generator, n: int) -> FloatArray:
        """Points (n, 2) in the region: Roberts' quasirandom sequence, shifted, and shaken so that no lattice shows."""
        low, high = np.array(self._region.low_m), np.array(self._region.high_m)
        sequence = np.arange(1, n + 1)[:, None] * (1 / _PLASTIC, 1 / _PLASTIC**2)
        shaken = rng.random(2) + sequence + rng.normal(0, 0.4, (n, 2)) * math.sqrt(self._region.area_m2 / max(n, 1)) / (
            high - low)
        return np.asarray(low + (shaken % 1) * (high - low))


def _with_arms(places_m: FloatArray, arm_m: float) -> FloatArray:
    """Places (N, 2), and a point to the east and one to the north of each: (3 N, 2)."""
    return np.asarray(places_m + arm_m * np.array([[[0.0, 0.0]], [[1.0, 0.0]], [[0.0, 1.0]]])).reshape(-1, 2)


@dataclass(frozen=True, eq=False)
class _Cohort:
    """N particles born together."""

    paths: Paths
    traits: FloatArray
    number: IdArray
    born_s: float
    arm_m: float

    def at(self, time_s: float, life_s: float) -> Drifting:
        centre, east, north = self.paths.at(time_s).reshape(3, -1, 2)
        deformation = np.stack([east - centre, north - centre], axis=2) / self.arm_m
        weight = math.sin(math.pi * (time_s - self.born_s) / life_s) ** 2
        return Drifting(centre, deformation, np.full(len(centre), weight), self.traits, self.number)
