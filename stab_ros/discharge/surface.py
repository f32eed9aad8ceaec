"""The surface velocity at each vertical: the median of the vectors within the search distance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from stab_ros.core.types import BoolArray, FloatArray, IdArray
from stab_ros.discharge.cross_section import CrossSection
from stab_ros.velocimetry.vectors import Vectors

_MEDIAN_LOSS = 1.2533  # standard error of a median over that of a mean, sqrt(pi / 2)
_MAD = 1.4826  # standard deviation over median absolute deviation, of a normal distribution
_POOLED_AS = 8  # tracks that the scatter of all verticals counts for at each


@dataclass(frozen=True, eq=False)
class SurfaceVelocities:
    """What the vectors say of N verticals; NaN where there are too few.

    Attributes:
        velocity_m_s: (N,), component across the section, positive downstream.
        sigma_m_s: (N,), standard deviation by what each vector has by itself.
        shared_m_s: (N, K), change by one standard deviation of each error that all vectors share.
        count: (N,), vectors within the search distance.
        along_m_s: (N,), component along the section.
        nearest_m: distance from any wet vertical to the nearest vector; infinite without vectors.
        downstream: (2,), unit vector across the section in the map.
    """

    velocity_m_s: FloatArray
    sigma_m_s: FloatArray
    shared_m_s: FloatArray
    count: IdArray
    along_m_s: FloatArray
    nearest_m: float
    downstream: FloatArray

    @property
    def known(self) -> BoolArray:
        """(N,), which verticals are measured."""
        return np.isfinite(self.velocity_m_s)


def surface_velocities(section: CrossSection, wet: BoolArray, vectors: Vectors, search_m: float, min_vectors: int
                       ) -> SurfaceVelocities:
    """Medians at the verticals of a section (Perks 2020, 2.2.5), with their standard deviation.

    The standard deviation is that of a median of as many values as there are tracks, from the scatter around it and,
    where that is larger, from the vectors' own covariance. Few tracks tell no scatter, so that of all verticals joins.

    Args:
        section: the verticals.
        wet: (N,), which of them lie under water; only these are measured.
        vectors: in the map, in metres.
        search_m: search distance.
        min_vectors: fewer of them make no median.
    """
    near, nearest_m = _near(section, wet, vectors, search_m)
    downstream = _downstream(section.normal, vectors, near)
    across, own = vectors.velocity_m_s @ downstream, np.einsum("i,nij,j->n", downstream, vectors.covariance, downstream)
    groups = [found if len(found) >= min_vectors else found[:0] for found in near]
    tracks = np.array([len(np.unique(vectors.track_id[found])) for found in groups])
    scatter = _scatter(across, own, groups, tracks)
    shared = np.einsum("i,nik->nk", downstream, vectors.shared)
    return SurfaceVelocities(
        _medians(across, groups), _MEDIAN_LOSS * scatter / np.sqrt(np.maximum(tracks, 1)),
        np.array([_median(shared[found]) for found in groups]).reshape(len(section), shared.shape[1]),
        np.array([len(found) for found in near], np.int64),
        _medians(vectors.velocity_m_s @ section.along, groups), nearest_m, downstream)


def _near(section: CrossSection, wet: BoolArray, vectors: Vectors, search_m: float) -> tuple[list[IdArray], float]:
    """The vectors at each vertical, and how near the nearest one of all is."""
    none = np.empty(0, np.int64)
    if not len(vectors):
        return [none] * len(section), np.inf
    tree = cKDTree(vectors.position_m)
    found = [np.sort(np.array(tree.query_ball_point(place, search_m), np.int64)) if under else none
             for place, under in zip(section.position_m, wet, strict=True)]
    distance_m, _ = tree.query(section.position_m[wet])
    return found, float(np.min(distance_m))


def _downstream(normal: FloatArray, vectors: Vectors, near: list[IdArray]) -> FloatArray:
    """The normal on the side to which the water flows."""
    used = np.unique(np.concatenate(near))
    sign = -1.0 if len(used) and (vectors.velocity_m_s[used] @ normal).sum() < 0 else 1.0
    return np.asarray(sign * normal)


def _scatter(across: FloatArray, own: FloatArray, groups: list[IdArray], tracks: IdArray) -> FloatArray:
    """(N,), standard deviation of single tracks around the median of their vertical."""
    seen = np.array([_MAD * float(np.median(np.abs(across[found] - np.median(across[found])))) if len(found) else np.nan
                     for found in groups])
    many = seen[tracks > 2]
    pooled = float(np.median(many)) if len(many) else np.nan
    joint = seen if np.isnan(pooled) else np.sqrt((tracks * seen**2 + _POOLED_AS * pooled**2) / (tracks + _POOLED_AS))
    return np.asarray(np.maximum(joint, np.sqrt(_medians(own, groups))))


def _medians(values: FloatArray, groups: list[IdArray]) -> FloatArray:
    return np.array([float(np.median(values[found])) if len(found) else np.nan for found in groups])


def _median(rows: FloatArray) -> FloatArray:
    """The median of each column; 0 without rows."""
    return np.median(rows, axis=0) if len(rows) else np.zeros(rows.shape[1])
