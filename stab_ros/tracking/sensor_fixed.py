"""What is fixed to the camera and not to the scene: overlays, dirt on the lens, hot pixels, borders.

Where the camera moves, the template of a scene no longer matches at its old place in the image. A template of an
overlay matches there in every frame. It has then no motion at all, as ground seen by a camera that stands still.
"""

from __future__ import annotations

import cv2
import numpy as np

from stab_ros.core.geometry import apply
from stab_ros.core.types import BoolArray, FloatArray, Gray, Homography, IdArray
from stab_ros.estimation.problem import strongest
from stab_ros.methods import spread
from stab_ros.methods.patches import Measurements, Patches, cut_patches, measure_patches

_MATCHES = 0.6  # correlation at the old place: over a scene that moves, 99 % of the patches have less than 0.45
_MOST = 0.5  # of the frames
_RADIUS_PX = 8
_REACH_PX = 12  # from the centre of a patch: others within it show some of the same
_EACH_FRAME = 150  # patches that are looked at
_TIMES = 3  # that a patch is found in place, more often than not
_MOVED_PX = 3.0  # of the scene: a template does not match there any more
_AT_REST_PX = 0.1  # all patches together, beyond which it is no overlay on a scene that moves
_SHOWN = 0.1  # of the information along the other axis, at least, to know a motion along one
_STILL_PX = 0.3  # along the axis that the template determines best: an edge does not show a motion along itself


class SensorFixed:
    """Watches N patches of the reference at their own places in the frames after it."""

    def __init__(self, patches: Patches) -> None:
        self._patches = patches
        self._frames: list[Measurements] = []

    def add(self, gray: Gray) -> None:
        """Takes the next frame, (h, w) uint8."""
        self._frames.append(measure_patches(self._patches, np.arange(len(self._patches)), gray, np.eye(3)))

    def features(self) -> BoolArray:
        """(N,) bool: which of the patches match in place in most frames of the later half; none if they have moved.

        A camera that is fixed to the ground sways a little, and the ground with it. An overlay does not.
        """
        late = self._frames[len(self._frames) // 2 :]
        none = np.zeros(len(self._patches), bool)
        if not late:
            return none
        found = np.mean([_in_place(one) for one in late], axis=0) > _MOST
        moved_px = np.median([_shift_px(one, found) for one in late])
        return found if moved_px < _AT_REST_PX else none


class InPlaceCheck:
    """Watches patches of one anchor frame at their own places, some in each frame, once the view has moved on."""

    def __init__(self, anchor: Gray, features_px: FloatArray) -> None:
        """anchor: (h, w) uint8. features_px: (N, 2), where the patches are cut."""
        centres = spread.within(np.round(features_px).astype(np.int64), anchor.shape, _RADIUS_PX)
        self._patches = cut_patches(anchor, centres, _RADIUS_PX)
        self._score = np.zeros(len(self._patches), np.int64)
        self._found: BoolArray = np.zeros(len(self._patches), bool)
        self._turn = 0

    def found(self, gray: Gray, anchor_H_cur: Homography) -> FloatArray:
        """(n, 2) px: patches that a frame, (h, w) uint8, there shows to be fixed to the camera, and none before did.

        That takes several frames: a regular texture can match in place by chance.
        """
        which = self._next(anchor_H_cur)
        if not len(which):
            return np.zeros((0, 2))
        still = _in_place(measure_patches(self._patches, which, gray, np.eye(3)))
        self._score[which] = np.maximum(self._score[which] + np.where(still, 1, -1), 0)
        fresh = (self._score >= _TIMES) & ~self._found
        self._found |= fresh
        return self._patches.centres[fresh].astype(np.float64)

    def _next(self, anchor_H_cur: Homography) -> IdArray:
        """Those that are suspected or whose turn it is, if the scene has moved away from them."""
        step = max(1, -(-len(self._patches) // _EACH_FRAME))
        suspected = (self._score > 0) & ~self._found
        suspected[self._turn % step :: step] = True
        which = np.flatnonzero(suspected)
        self._turn += 1
        centres = self._patches.centres[which].astype(np.float64)
        away_px: FloatArray = np.hypot(*(apply(anchor_H_cur, centres) - centres).T)
        return which[away_px > _MOVED_PX]


def fixed_area(points_px: FloatArray, size: tuple[int, int]) -> BoolArray:
    """(h, w) bool: what patches at the points (n, 2) show, and those that overlap them by half."""
    area = np.zeros(size[::-1], np.uint8)
    for x, y in np.round(points_px).astype(int).tolist():
        cv2.rectangle(area, (x - _REACH_PX, y - _REACH_PX), (x + _REACH_PX, y + _REACH_PX), 1, cv2.FILLED)
    return np.asarray(area, bool)


def _in_place(found: Measurements) -> BoolArray:
    """(N,) bool: which patches match without a displacement along the axis that their texture determines best."""
    squared = np.einsum("na,nab,nb->n", found.displacement, found.information, found.displacement)
    best_axis_px = np.sqrt(squared / np.maximum(strongest(found.information), 1e-9))
    return np.asarray((found.correlation > _MATCHES) & (best_axis_px < _STILL_PX))


def _shift_px(found: Measurements, which: BoolArray) -> float:
    """How far the patches have moved together, by each one's motion along its best axis; 0 along what none shows."""
    values, axes = np.linalg.eigh(found.information[which])
    best, strength = axes[:, :, 1], values[:, 1]
    along = strength * np.einsum("na,na->n", best, found.displacement[which])
    total, directions = np.linalg.eigh(np.einsum("n,na,nb->ab", strength, best, best))
    known = total > _SHOWN * total[1]
    return float(np.linalg.norm((directions.T @ (along @ best))[known] / total[known]))
