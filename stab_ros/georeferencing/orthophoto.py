"""Orthophotos: one interpolation from the picture as taken, lens and homography at once."""

from __future__ import annotations

import cv2
import numpy as np

from stab_ros.core.types import Homography, Image
from stab_ros.georeferencing.horizon import with_positive_depth
from stab_ros.imaging.camera import Camera
from stab_ros.imaging.lens import RemapTables
from stab_ros.imaging.warp import INTERPOLATION, Allocate, warp


class Orthophotos:
    """Maps the pictures of a camera to grids; where the camera is still, the tables of the last frame serve again."""

    def __init__(self, camera: Camera, interpolation: str) -> None:
        """interpolation: nearest, linear, cubic or lanczos."""
        self._camera, self._interpolation = camera, interpolation
        self._of: tuple[bytes, tuple[int, int]] | None = None  # homography and size of the tables
        self._tables: RemapTables | None = None

    def make(self, image: Image, ortho_H_image: Homography, size: tuple[int, int],
             allocate: Allocate = np.empty) -> Image:
        """Maps a picture to the grid of an orthophoto.

        Args:
            image: (h, w) or (h, w, channels), uint8, uint16 or float32, as taken.
            ortho_H_image: (3, 3), from undistorted pixels to those of the orthophoto.
            size: width and height of the orthophoto, px.
            allocate: makes the array for the result from its shape and dtype.

        Returns:
            (rows, columns) or (rows, columns, channels), the dtype of `image`; 0 where the picture shows nothing of the
            water plane, so also above the horizon.
        """
        H = with_positive_depth(ortho_H_image)
        if not self._camera.distorts and _in_front(H, size):
            return warp(image, H, size, self._interpolation, None, allocate=allocate)
        x_px, y_px = self._tables_of(H, size)
        result = allocate((size[1], size[0], *image.shape[2:]), image.dtype)
        cv2.remap(image, x_px, y_px, INTERPOLATION[self._interpolation], result, cv2.BORDER_CONSTANT)
        return result

    def _tables_of(self, H: Homography, size: tuple[int, int]) -> RemapTables:
        of = (H.tobytes(), size)
        if self._tables is None or self._of != of:
            self._of, self._tables = of, self._camera.maps(H, size)
        return self._tables


def _in_front(ortho_H_image: Homography, size: tuple[int, int]) -> bool:
    """Whether the whole grid lies in front of the camera: the depth is linear, so its corners tell."""
    x, y = size[0] - 1.0, size[1] - 1.0
    depth = np.linalg.inv(ortho_H_image)[2] @ np.array([[0, x, 0, x], [0, 0, y, y], [1, 1, 1, 1.0]])
    return bool((depth > 0).all())
