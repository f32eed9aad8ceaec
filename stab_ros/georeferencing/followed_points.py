"""Control points followed from frame to frame by the patches around them, cut from the frame that they were marked in.

Pyramidal Lucas-Kanade (Bouguet 2001) finds a point again near where it is expected; then the patch of the first frame
is aligned, so that errors do not accumulate (Baker and Matthews 2004). A patch that does not look as it did is hidden.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from stab_ros.core.geometry import point_jacobian
from stab_ros.core.types import BoolArray, FloatArray, Gray, Homography, IdArray
from stab_ros.methods.patches import Patches, cut_patches, measure_patches

_MARGIN_PX = 12  # that patches need around them, beyond their own size
_LEVELS, _WINDOW_PX = 4, 31  # of Lucas-Kanade
_STEPS, _CONVERGED_PX = 8, 0.003
_MOST_PX = 4.0  # displacement from which on a patch has been aligned to something else
_LEAST_CORRELATION = 0.8


@dataclass(frozen=True, eq=False)
class FollowedPoints:
    """Where N points are in a frame.

    Attributes:
        pixels: (N, 2), px of the image as taken; NaN where not found.
        covariance_px2: (N, 2, 2), of the displacement alone, without the error of the mark.
        found: (N,) bool.
    """

    pixels: FloatArray
    covariance_px2: FloatArray
    found: BoolArray


class PointFollower:
    """Follows points that were marked in one frame."""

    def __init__(self, gray: Gray, marks_px: FloatArray, side_px: int) -> None:
        """Cuts the patches.

        Args:
            gray: (h, w) uint8, the frame in which the points were marked.
            marks_px: (N, 2), px of it.
            side_px: of a patch, odd.
        """
        self._marks, radius = marks_px, side_px // 2
        centres = np.rint(marks_px).astype(np.int64)
        reach = radius + _MARGIN_PX
        inside = ((centres >= reach) & (centres < np.array(gray.shape[::-1]) - reach)).all(axis=1)
        self._patches = cut_patches(gray, centres[inside], radius) if inside.any() else None
        self._of = np.full(len(marks_px), -1)  # the patch of each point; -1: it has none
        if self._patches is not None:
            self._of = _places_of(self._patches, centres)
        self._seen: Gray = gray.copy()  # the last frame that was placed

    @property
    def usable(self) -> BoolArray:
        """(N,) bool: which points have a patch with structure in both directions."""
        return np.asarray(self._of >= 0)

    def keep(self, gray: Gray) -> None:
        """Takes a frame, (h, w) uint8, as the one from which points are followed to the next."""
        self._seen = gray.copy()

    def moved(self, gray: Gray, kept_px: FloatArray) -> FloatArray:
        """Roughly where points are in the next frame, (N, 2), px.

        Args:
            gray: (h, w) uint8, the next frame.
            kept_px: (N, 2), where they are in the frame that was kept.
        """
        places, _, _ = cv2.calcOpticalFlowPyrLK(
            self._seen, gray, np.ascontiguousarray(kept_px, np.float32), None, winSize=(_WINDOW_PX, _WINDOW_PX),
            maxLevel=_LEVELS)
        return np.asarray(places, np.float64)

    def find(self, gray: Gray, expected_px: FloatArray, cur_H_first: Homography) -> FollowedPoints:
        """Finds the points in a frame by the patches of the first one.

        Args:
            gray: (h, w) uint8.
            expected_px: (N, 2), where they are within a few pixels; NaN: not to be sought.
            cur_H_first: (3, 3), how the frame is deformed relative to the first one.
        """
        n = len(self._marks)
        found = FollowedPoints(np.full((n, 2), np.nan), np.zeros((n, 2, 2)), np.zeros(n, bool))
        chosen = np.flatnonzero(self.usable & np.isfinite(expected_px).all(axis=1))
        if self._patches is not None and len(chosen):
            self._align(self._patches, gray, chosen, expected_px[chosen], found, cur_H_first)
        return found

    def _align(self, patches: Patches, gray: Gray, chosen: IdArray, at_mark: FloatArray, found: FollowedPoints,
               H: Homography) -> None:
        """Fills in the places of the chosen points. at_mark: (n, 2), where they are expected."""
        of = self._of[chosen]
        centres = patches.centres[of].astype(float)
        A = point_jacobian(H, centres)
        off = np.einsum("nij,nj->ni", A, self._marks[chosen] - centres)
        at, measured = at_mark - off, None
        for _ in range(_STEPS):
            measured = measure_patches(patches, of, gray, H, at)
            step = np.einsum("nij,nj->ni", A, measured.displacement)
            at = at + step
            if np.abs(step).max() < _CONVERGED_PX:
                break
        assert measured is not None
        steady = np.linalg.norm(measured.displacement, axis=1) < 10 * _CONVERGED_PX
        near = np.linalg.norm(at + off - at_mark, axis=1) < _MOST_PX
        good = steady & near & (measured.correlation > _LEAST_CORRELATION)
        found.found[chosen[good]] = True
        found.pixels[chosen[good]] = (at + off)[good]
        covariance = np.linalg.inv(measured.information[good])
        found.covariance_px2[chosen[good]] = A[good] @ covariance @ A[good].transpose(0, 2, 1)


def _places_of(patches: Patches, centres: IdArray) -> IdArray:
    """(N,) row of the patch at each centre; -1 without one."""
    row = {tuple(place): k for k, place in enumerate(patches.centres.tolist())}
    return np.array([row.get(tuple(place), -1) for place in centres.tolist()])
