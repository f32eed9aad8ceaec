"""Where static ground lies in the reference, as an image: known of features, and extended to their Voronoi cells."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from stab_ros.core.errors import InputError
from stab_ros.core.geometry import inside
from stab_ros.core.types import BoolArray, FloatArray, Gray

_GROUND = 128
_STEP_PX = 4  # of the grid that the ground is kept on: finer than features lie apart


@dataclass(frozen=True, eq=False)
class StaticMap:
    """cells: (h/4, w/4) uint8, from 0, not ground, to 255, ground. size: width, height of the reference, px."""

    cells: Gray
    size: tuple[int, int]

    @staticmethod
    def of_features(features_px: FloatArray, trust: FloatArray, size: tuple[int, int]) -> StaticMap:
        """Each pixel takes the weight, (N,) in [0, 1], of the nearest of the features at (N, 2) px."""
        shape = (-(-size[1] // _STEP_PX), -(-size[0] // _STEP_PX))
        free = np.full(shape, 255, np.uint8)
        column, row = (np.clip(features_px.T // _STEP_PX, 0, np.array(shape[::-1])[:, None] - 1)).astype(int)
        free[row, column] = 0
        _, label = cv2.distanceTransformWithLabels(free, cv2.DIST_L2, cv2.DIST_MASK_5, labelType=cv2.DIST_LABEL_PIXEL)
        level = np.zeros(int(label.max()) + 1, np.uint8)
        level[label[row, column]] = np.round(255 * trust)
        return StaticMap(np.asarray(level[label]), size)

    @staticmethod
    def of_mask(allowed: BoolArray) -> StaticMap:
        """All of `allowed`, (h, w) bool, is ground, the rest is not."""
        return StaticMap.of_picture(allowed.astype(np.uint8) * 255)

    @staticmethod
    def of_picture(picture: Gray) -> StaticMap:
        """A map from an image, (h, w) uint8: 0, not ground, to 255, ground."""
        height, width = picture.shape
        cells = cv2.resize(picture, (-(-width // _STEP_PX), -(-height // _STEP_PX)), interpolation=cv2.INTER_NEAREST)
        return StaticMap(np.asarray(cells), (width, height))

    def picture(self) -> Gray:
        """(h, w) uint8 of the size of the reference."""
        whole = np.repeat(np.repeat(self.cells, _STEP_PX, axis=0), _STEP_PX, axis=1)
        return np.ascontiguousarray(whole[: self.size[1], : self.size[0]])

    def at(self, points_px: FloatArray) -> FloatArray:
        """(N,) in [0, 1], how much (N, 2) px of the reference are ground; 1 outside of it, where nothing is known."""
        shown = inside(points_px, self.size)
        column, row = (points_px[shown].T // _STEP_PX).astype(int)
        ground = np.ones(len(points_px))
        ground[shown] = self.cells[row, column] / 255.0
        return ground

    def differs(self, other: StaticMap) -> float:
        """Share of the reference that one map takes for ground and the other does not."""
        return float(np.mean((self.cells >= _GROUND) != (other.cells >= _GROUND)))

    def check_size(self, size: tuple[int, int]) -> None:
        """Raises InputError for a reference of another size (width, height)."""
        if self.size != size:
            raise InputError(f"static_map: it is {self.size[0]}x{self.size[1]}, "
                             f"it must be {size[0]}x{size[1]} as the reference")
