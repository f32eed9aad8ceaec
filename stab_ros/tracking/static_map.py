"""Where static ground lies in the reference, as an image: known of features, and extended to their Voronoi cells."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from stab_ros.core.errors import InputError
from stab_ros.core.geometry import inside
from stab_ros.core.types import BoolArray, FloatArray, Gray

_GROUND = 128
_LEAST_SHARE = 0.01  # of the reference, of ground and of what is none, for a map to tell them apart
_STEP_PX = 4  # of the grid that the ground is kept on: finer than features lie apart


@dataclass(frozen=True, eq=False)
class StaticMap:
    """Where static ground lies in the reference, on a grid of 4x4 px cells.

    Attributes:
        cells: (ceil(h/4), ceil(w/4)) uint8, from 0 (not ground) to 255 (ground).
        size: width and height of the reference, px.
    """

    cells: Gray
    size: tuple[int, int]

    @staticmethod
    def of_features(features_px: FloatArray, trust: FloatArray, size: tuple[int, int]) -> StaticMap:
        """Spreads what is known of features to the pixels nearest to each (its Voronoi cell).

        Args:
            features_px: (n, 2) float64, the features, in pixels of the reference.
            trust: (n,) float64 in [0, 1], how much each feature is trusted to be static ground.
            size: width and height of the reference, px.

        Returns:
            The map.
        """
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
        """Makes a map from a mask.

        Args:
            allowed: (h, w) bool, True where static ground is.

        Returns:
            The map.
        """
        return StaticMap.of_picture(allowed.astype(np.uint8) * 255)

    @staticmethod
    def of_picture(picture: Gray) -> StaticMap:
        """Makes a map from an image, as `picture` returns it.

        Args:
            picture: (h, w) uint8, from 0 (not ground) to 255 (ground).

        Returns:
            The map.
        """
        height, width = picture.shape
        return StaticMap(np.ascontiguousarray(picture[::_STEP_PX, ::_STEP_PX]), (width, height))

    @property
    def divides(self) -> bool:
        """Whether it tells ground from what is not: there is some of both."""
        return bool(_LEAST_SHARE < np.mean(self.cells >= _GROUND) < 1 - _LEAST_SHARE)

    def without(self, area: BoolArray) -> StaticMap:
        """Takes a part of the reference out of the ground.

        Args:
            area: (h, w) bool, what is not ground.

        Returns:
            The map.
        """
        cells = StaticMap.of_mask(area).cells
        return StaticMap(np.where(cells >= _GROUND, np.uint8(0), self.cells), self.size)

    def picture(self) -> Gray:
        """The map as an image of the size of the reference.

        Returns:
            (h, w) uint8, from 0 (not ground) to 255 (ground).
        """
        whole = np.repeat(np.repeat(self.cells, _STEP_PX, axis=0), _STEP_PX, axis=1)
        return np.ascontiguousarray(whole[: self.size[1], : self.size[0]])

    def at(self, points_px: FloatArray) -> FloatArray:
        """Looks up how much points are ground.

        Args:
            points_px: (n, 2) float64, in pixels of the reference.

        Returns:
            (n,) float64 in [0, 1]; 1 outside the reference, where nothing is known.
        """
        shown = inside(points_px, self.size)
        column, row = (points_px[shown].T // _STEP_PX).astype(int)
        ground = np.ones(len(points_px))
        ground[shown] = self.cells[row, column] / 255.0
        return ground

    def differs(self, other: StaticMap) -> float:
        """Compares two maps of the same reference.

        Args:
            other: another map.

        Returns:
            The share of the reference, in [0, 1], that is ground in one map and not in the other.
        """
        return float(np.mean((self.cells >= _GROUND) != (other.cells >= _GROUND)))

    def check_size(self, size: tuple[int, int]) -> None:
        """Checks that the map belongs to a reference of this size.

        Args:
            size: width and height of the reference, px.

        Raises:
            InputError: the map has another size.
        """
        if self.size != size:
            raise InputError(f"static_map: it is {self.size[0]}x{self.size[1]}, "
                             f"it must be {size[0]}x{size[1]} as the reference")
