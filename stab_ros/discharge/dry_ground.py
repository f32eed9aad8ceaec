"""Whether water runs where a section has none: vectors on ground that it calls dry.

A level that is too low, a section in the wrong place and a bed point that is too high all take water away without a
trace in the velocities that are used. What they leave is vectors beyond the waterline that move as only water does.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from stab_ros.core.text import counted
from stab_ros.core.types import BoolArray, FloatArray, IdArray
from stab_ros.discharge.cross_section import CrossSection
from stab_ros.discharge.settings import DischargeConfig
from stab_ros.discharge.surface import of_middle
from stab_ros.discharge.wetted import wet_lengths_m
from stab_ros.velocimetry.vectors import Vectors

_BANK = 0.02  # of the wet width, from the waterline on, that is left to errors of places and to windows of vectors
_BESIDE = 0.05  # of it, how far up- and downstream of the section vectors tell of its ground
_BEYOND = 0.1  # of it, how far the dry ends of a section tell of the ground beyond them
_EDGE_M = 1e-6  # a point of the bed that is no further from the water level was surveyed as the edge of the water
_GROUP = 10  # vectors next to each other, of which most move or do not
_MOVES = 0.1  # of the fastest water's speed; slower ones may lie on a bank that sways
_SIGMAS = 3.0  # of the velocity of a moving group
_LEVEL_SIGMAS = 2.0  # by which the water may stand higher
_MEDIAN_LOSS = 1.2533  # standard error of a median over that of a mean, sqrt(pi / 2)


def dry_ground_doubts(section: CrossSection, vectors: Vectors, downstream: FloatArray, fastest_m_s: float,
                      wse_m: float, config: DischargeConfig) -> tuple[str, ...]:
    """How many vectors move on dry ground, in one line; nothing where they may lie on water or stand still.

    Args:
        section: as surveyed.
        vectors: surface velocities in the map, m.
        downstream: (2,), unit vector across the section.
        fastest_m_s: largest velocity of its water.
        wse_m: water surface elevation.
        config: uncertainties of level and bed, and how many vectors tell a velocity.
    """
    highest_m = wse_m + _LEVEL_SIGMAS * float(np.hypot(config.wse_sigma_m, config.depth_sigma_m))
    width_m = float(wet_lengths_m(section.chainage_m, wse_m - section.bed_m).sum())
    near, chainage_m = _at_section(section, vectors, width_m)
    edges = np.abs(wse_m - section.bed_m) < _EDGE_M
    ground = _Ground(section.chainage_m, np.where(edges, -_EDGE_M, highest_m - section.bed_m))
    away_m = ground.from_water_m(chainage_m)
    groups = _groups(ground.stretch(chainage_m), away_m, np.flatnonzero(near & (away_m > _BANK * width_m)))
    moving = [one for one in groups if len(one) >= config.min_vectors
              and _moves(vectors[one], downstream, _MOVES * fastest_m_s)]
    if not moving:
        return ()
    found = np.concatenate(moving)
    speed_m_s = float(np.median(np.abs(vectors.velocity_m_s[found] @ downstream)))
    return (f"{counted(len(found), 'vector')} of {speed_m_s:.2g} m/s (median) on ground that the section calls dry, "
            f"up to {away_m[found].max():.2g} m from its water, so what flows there is missing: the water level is too "
            "low, the section lies in the wrong place or ends too early, or a point of its bed is too high",)


def _at_section(section: CrossSection, vectors: Vectors, width_m: float) -> tuple[BoolArray, FloatArray]:
    """(M,) whether vectors lie near enough to tell of the ground of the section; and their chainages."""
    away = vectors.position_m - section.position_m[0]
    chainage_m = away @ section.along + section.chainage_m[0]
    aside_m = away @ section.normal + section.offset_m[0] - np.interp(chainage_m, section.chainage_m, section.offset_m)
    low, high = section.chainage_m[[0, -1]] + np.array([-_BEYOND, _BEYOND]) * width_m
    return (np.abs(aside_m) <= _BESIDE * width_m) & (chainage_m >= low) & (chainage_m <= high), chainage_m


@dataclass(frozen=True, eq=False)
class _Ground:
    """A section under a water surface. chainage_m: (N,). depth_m: (N,), negative above the water."""

    chainage_m: FloatArray
    depth_m: FloatArray

    @cached_property
    def waterlines_m(self) -> FloatArray:
        """Where the bed meets the water surface, increasing."""
        wet = self.depth_m > 0
        at = np.flatnonzero(wet[1:] != wet[:-1])
        share = self.depth_m[at] / (self.depth_m[at] - self.depth_m[at + 1])
        return np.asarray(self.chainage_m[at] + share * (self.chainage_m[at + 1] - self.chainage_m[at]))

    def stretch(self, chainage_m: FloatArray) -> IdArray:
        """(M,), number of the stretch between two waterlines in which places lie."""
        return np.searchsorted(self.waterlines_m, chainage_m)

    def from_water_m(self, chainage_m: FloatArray) -> FloatArray:
        """(M,), distance of places from the water; 0 on it."""
        behind = self.stretch(chainage_m)
        lines = np.concatenate([[-np.inf], self.waterlines_m, [np.inf]])
        away = np.minimum(chainage_m - lines[behind], lines[behind + 1] - chainage_m)
        return np.where(np.interp(chainage_m, self.chainage_m, self.depth_m) > 0, 0.0, away)


def _groups(stretch: IdArray, away_m: FloatArray, dry: IdArray) -> list[IdArray]:
    """Dry vectors in groups of their stretch, from the water on; the last of each may be smaller."""
    found = []
    for one in np.unique(stretch[dry]):
        own = dry[stretch[dry] == one]
        own = own[np.argsort(away_m[own], kind="stable")]
        found += [own[start : start + _GROUP] for start in range(0, len(own), _GROUP)]
    return found


def _moves(group: Vectors, downstream: FloatArray, least_m_s: float) -> bool:
    """Whether most of a group move, by more than their errors make a median."""
    across = group.velocity_m_s @ downstream
    own = float(np.median(np.einsum("i,nij,j->n", downstream, group.covariance, downstream)))
    shared = of_middle(np.einsum("i,nik->nk", downstream, group.shared), across)
    sigma = np.sqrt(_MEDIAN_LOSS**2 * own / len(np.unique(group.track_id)) + (shared**2).sum())
    return bool(abs(np.median(across)) > max(least_m_s, _SIGMAS * float(sigma)))
