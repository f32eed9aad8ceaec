"""Where something is seen to stand that moving features of the water have passed, as a bed that shows through.

At the end of an interval a feature has gone on. If its first look is still seen where it would be without motion, that
is not the water: something stands there, and shines through. Textures are alike by chance, and the nearer the more, so
it is compared with the place as far beyond the end of the track: there the water is by chance as much like the first
look, and nothing stands that was part of it.
"""

from __future__ import annotations

import cv2
import numpy as np
from scipy.spatial import cKDTree

from stab_ros.core.types import BoolArray, FloatArray, IdArray
from stab_ros.velocimetry.carried import Footprints
from stab_ros.velocimetry.placed_frame import PlacedFrame
from stab_ros.velocimetry.places import pixels_of
from stab_ros.velocimetry.settings import VelocityConfig
from stab_ros.velocimetry.tracks import Tracks

CHI2_99 = 9.21  # of two degrees of freedom
# Neighbours, and their mean correlation at rest above that by chance: over the bed of seeds 1 and 2 of basento it is
# 0.2 in the median, and 0.1 or less in 1 % of the places; on a surface that changes it is above 0.1 in 2 % at most.
_NEIGHBOURS, _MORE_ALIKE = 16, 0.1
_ENOUGH = 2000  # features that tell; of more, some are left out
_MOST = 0.5  # share of the places at which something stands from which on all are doubted


def over_what_stands(tracks: Tracks, which: IdArray, first: PlacedFrame, last: PlacedFrame,
                     config: VelocityConfig) -> BoolArray:
    """(n,) bool: whether something stands around the starts of the tracks `which`, (n,).

    Args:
        tracks: finished.
        which: of them, (n,); those that were followed to the end and have moved tell.
        first: frame of the interval.
        last: frame of the interval.
        config: the settings.
    """
    start_m, seen = tracks.places_m[0], which[tracks.alive[which]]
    moved_m = tracks.places_m[-1] - start_m
    telling = seen[np.asarray(squares(moved_m[seen], tracks.covariance_m2[seen]) > CHI2_99)]
    telling = telling[:: len(telling) // _ENOUGH + 1]
    if not len(telling):
        return np.zeros(len(which), bool)
    windows = _Windows(first, tracks.start_px[telling], config.block_px // 2)
    at_rest, beyond = (windows.alike(last, start_m[telling] + ways * moved_m[telling]) for ways in (0, 2))
    return _is_more(at_rest - beyond, start_m[telling], start_m[which])


def _is_more(difference: FloatArray, places_m: FloatArray, wanted_m: FloatArray) -> BoolArray:
    """(m,) bool, whether it is more than by chance around places (m, 2); differences (n,) at (n, 2), NaN: unknown."""
    known = np.isfinite(difference)
    if np.count_nonzero(known) < _NEIGHBOURS:
        return np.zeros(len(wanted_m), bool)
    nearest = np.asarray(cKDTree(places_m[known]).query(wanted_m, k=_NEIGHBOURS)[1])
    stands = np.asarray(np.mean(difference[known][nearest], axis=1) > _MORE_ALIKE)
    return np.asarray(stands | (np.mean(stands) > _MOST))


def squares(way_m: FloatArray, covariance_m2: FloatArray) -> FloatArray:
    """(n,), squared lengths of ways (n, 2) in their standard deviations."""
    return np.asarray(np.einsum("ni,nij,nj->n", way_m, np.linalg.pinv(covariance_m2, hermitian=True), way_m))


class _Windows:
    """Windows of a frame as they are, to be compared where the plane carries them."""

    def __init__(self, frame: PlacedFrame, centres_px: FloatArray, radius: int) -> None:
        """centres_px: (n, 2). radius: half the side, px."""
        y, x = np.mgrid[-radius : radius + 1, -radius : radius + 1]
        self._offsets = np.stack([x.ravel(), y.ravel()])
        self._footprints = Footprints.of(frame, centres_px)
        self._looks = self._seen(frame, centres_px, np.broadcast_to(np.eye(2), (len(centres_px), 2, 2)))

    def alike(self, frame: PlacedFrame, places_m: FloatArray) -> FloatArray:
        """(n,) correlation with what a frame shows at places (n, 2), 0 and more; NaN: partly out of sight, or flat."""
        seen = self._seen(frame, pixels_of(frame, places_m), self._footprints.carried(frame, places_m))
        return np.asarray(np.maximum(np.einsum("nk,nk->n", self._looks, seen), 0.0))

    def _seen(self, frame: PlacedFrame, at_px: FloatArray, carried: FloatArray) -> FloatArray:
        """(n, k) grey levels around pixels (n, 2), of mean 0 and length 1; NaN: out of sight, or flat."""
        points = (at_px[:, :, None] + carried @ self._offsets).astype(np.float32)  # (n, 2, k)
        high = np.array(frame.gray.shape[::-1])[:, None] - 1
        outside = ~((points >= 0) & (points <= high)).all(axis=(1, 2))
        points[outside] = 0
        levels = cv2.remap(frame.gray.astype(np.float32), points[:, 0], points[:, 1], cv2.INTER_LINEAR)
        levels -= levels.mean(axis=1, keepdims=True)
        length = np.where(outside, np.nan, np.linalg.norm(levels, axis=1))
        length = np.where(length > 0, length, np.nan)[:, None]
        return np.asarray(levels / length)
