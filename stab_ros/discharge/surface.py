"""The surface velocity at each vertical: the median of what the vectors within the search distance tell of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from stab_ros.core.robust import robust_sigma
from stab_ros.core.types import BoolArray, FloatArray, IdArray
from stab_ros.discharge.cross_section import CrossSection
from stab_ros.discharge.local_change import Change, local_change
from stab_ros.discharge.wetted import DRY, channel_width_m, channels
from stab_ros.velocimetry.vectors import Vectors

_MEDIAN_LOSS = 1.2533  # standard error of a median over that of a mean, sqrt(pi / 2)
_POOLED_AS = 8  # tracks that the scatter of all verticals counts for at each
_REACH = 2.0  # search distances within which vectors tell the gradient around a vertical
_STEEPEST = 4.0  # gradient of a parabolic profile at its shores, in largest velocities a width; its curvature is twice


@dataclass(frozen=True, eq=False)
class SurfaceVelocities:
    """What the vectors say of N verticals; NaN where there are too few.

    Attributes:
        velocity_m_s: (N,), component across the section, positive downstream.
        sigma_m_s: (N,), standard deviation by what each vector has by itself.
        shared_m_s: (N, K), change by one standard deviation of each error that vectors share.
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

    Each vector within the search distance is carried to the vertical by how the velocity changes around it, see
    `local_change`. The standard deviation is that of a median of as many values as there are tracks, from the scatter
    around it and, where that is larger, from the vectors' own covariance; that of the change is added. Few tracks tell
    no scatter, so that of all verticals joins.

    Args:
        section: the verticals.
        wet: (N,), which of them lie under water; only these are measured.
        vectors: in the map, in metres; each counts for verticals of the channel in which it lies, or nearest to it.
        search_m: search distance.
        min_vectors: fewer of them make no median.
    """
    near, nearest_m = _near(section, wet, vectors, search_m)
    groups = [found if len(found) >= min_vectors else found[:0] for found in near]
    downstream = _downstream(section, vectors, groups)
    across, own = vectors.velocity_m_s @ downstream, np.einsum("i,nij,j->n", downstream, vectors.covariance, downstream)
    tracks = np.array([len(np.unique(vectors.track_id[found])) for found in groups])
    offsets = [_offset_m(section, i, vectors, found) for i, found in enumerate(groups)]
    changes = _changes(section, wet, vectors, across, groups, _REACH * search_m)
    told = [across[found] - change.at(offset) for found, change, offset in zip(groups, changes, offsets, strict=True)]
    scatter = np.maximum(_scatter(told, tracks), np.sqrt(_medians(own, groups)))
    aside = np.array([change.sigma_m_s(offset) if len(offset) else 0.0
                      for change, offset in zip(changes, offsets, strict=True)])
    shared = np.einsum("i,nik->nk", downstream, vectors.shared)
    return SurfaceVelocities(
        np.array([float(np.median(one)) if len(one) else np.nan for one in told]),
        np.hypot(_MEDIAN_LOSS * scatter / np.sqrt(np.maximum(tracks, 1)), aside),
        np.array([of_middle(shared[found], one) for found, one in zip(groups, told, strict=True)]
                 ).reshape(len(section), shared.shape[1]),
        np.array([len(found) for found in near], np.int64),
        _medians(vectors.velocity_m_s @ section.along, groups), nearest_m, downstream)


def _near(section: CrossSection, wet: BoolArray, vectors: Vectors, search_m: float) -> tuple[list[IdArray], float]:
    """The vectors at each vertical, and how near the nearest one of all is."""
    if not len(vectors):
        return [np.empty(0, np.int64)] * len(section), np.inf
    distance_m, _ = cKDTree(vectors.position_m).query(section.position_m[wet])
    return _of_channel(section, wet, vectors, search_m), float(np.min(distance_m))


def _of_channel(section: CrossSection, wet: BoolArray, vectors: Vectors, within_m: float) -> list[IdArray]:
    """Of each wet vertical, the vectors so near that do not lie in another channel, as beyond an island."""
    tree, own = cKDTree(vectors.position_m), channels(np.where(wet, 1.0, -1.0))
    chainage_m = (vectors.position_m - section.position_m[0]) @ section.along + section.chainage_m[0]
    under = section.chainage_m[wet]
    of_vector = own[wet][np.searchsorted((under[1:] + under[:-1]) / 2, chainage_m)]
    found = [np.sort(np.array(tree.query_ball_point(place, within_m), np.int64)) for place in section.position_m]
    return [one[(of_vector[one] == channel) & (channel != DRY)] for one, channel in zip(found, own, strict=True)]


def _offset_m(section: CrossSection, vertical: int, vectors: Vectors, found: IdArray) -> FloatArray:
    """(n, 2), how far vectors lie from a vertical, along the section and across it."""
    return np.asarray((vectors.position_m[found] - section.position_m[vertical])
                      @ np.column_stack([section.along, section.normal]))


def _changes(section: CrossSection, wet: BoolArray, vectors: Vectors, across: FloatArray, groups: list[IdArray],
             reach_m: float) -> list[Change]:
    """How the component across the section changes around each vertical that has vectors; not at all without."""
    medians = _medians(across, [found for found in groups if len(found)])
    width_m = _widths_m(section, wet)
    usual = np.abs(medians).max(initial=0) * np.column_stack(
        [_STEEPEST / width_m] * 2 + [2 * _STEEPEST / width_m**2] * 2)
    wide = _of_channel(section, wet, vectors, reach_m) if len(medians) else groups
    return [local_change(_offset_m(section, i, vectors, around), across[around], reach_m, usual[i])
            if len(groups[i]) else Change.none() for i, around in enumerate(wide)]


def _widths_m(section: CrossSection, wet: BoolArray) -> FloatArray:
    """(N,), from the point before to that behind the channel of each vertical; that of the section for dry ones."""
    own = channels(np.where(wet, 1.0, -1.0))
    width = np.full(len(section), section.chainage_m[-1] - section.chainage_m[0])
    for channel in range(own.max() + 1):
        width[own == channel] = channel_width_m(section.chainage_m, own == channel)
    return width


def _downstream(section: CrossSection, vectors: Vectors, groups: list[IdArray]) -> FloatArray:
    """The normal on the side to which more water flows: the sum over verticals of median times width.

    So neither a few wild vectors decide it, as they would by the mean of all, nor the many vectors of a slow eddy, as
    they would by the side to which most point.
    """
    median = _medians(vectors.velocity_m_s @ section.normal, groups)
    flows_back = np.nansum(median * np.gradient(section.chainage_m)) < 0
    return np.asarray(-section.normal if flows_back else section.normal)


def _scatter(told: Sequence[FloatArray], tracks: IdArray) -> FloatArray:
    """(N,), standard deviation of single tracks around the median of their vertical."""
    seen = np.array([float(robust_sigma(one)) if len(one) else np.nan for one in told])
    many = seen[tracks > 2]
    pooled = float(np.median(many)) if len(many) else np.nan
    joint = seen if np.isnan(pooled) else np.sqrt((tracks * seen**2 + _POOLED_AS * pooled**2) / (tracks + _POOLED_AS))
    return np.asarray(joint)


def _medians(values: FloatArray, groups: list[IdArray]) -> FloatArray:
    return np.array([float(np.median(values[found])) if len(found) else np.nan for found in groups])


def of_middle(rows: FloatArray, told: FloatArray) -> FloatArray:
    """The mean of each column over the half of the vectors in the middle of what they tell; 0 without rows.

    That is how the median of what they tell moves. The median of a column would be 0 where it is of an error that only
    some of the vectors have, as those of one interval.
    """
    n = len(told)
    middle = rows[np.argsort(told, kind="stable")[n // 4 : n - n // 4]]
    return middle.mean(axis=0) if n else np.zeros(rows.shape[1])
