"""Orthophotos: one interpolation from the picture as taken, lens and homography at once."""

from __future__ import annotations

import math

import cv2
import numpy as np

from stab_ros.core.downscale import Downscaling
from stab_ros.core.geometry import apply, grid, inside, point_jacobian
from stab_ros.core.types import Homography, Image
from stab_ros.georeferencing.horizon import with_positive_depth
from stab_ros.imaging.camera import Camera
from stab_ros.imaging.lens_maps import QuickTables, RemapTables
from stab_ros.imaging.resampling import is_resampled, resample_at
from stab_ros.imaging.warp import INTERPOLATION, Allocate, warp

_LOOKED_AT = 16  # rows from one to the next, to decide how a picture is mapped


class Orthophotos:
    """Maps the pictures of a camera to grids; where the camera is still, the tables of the last frame serve again."""

    def __init__(self, camera: Camera, interpolation: str) -> None:
        """interpolation: nearest, linear, cubic or lanczos."""
        self._camera, self._interpolation = camera, interpolation
        self._of: tuple[bytes, tuple[int, int]] | None = None  # homography and size of the tables
        self._tables: RemapTables | QuickTables | None = None

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
        downscaling = Downscaling(_level(H, size, self._camera.size))
        if downscaling.level:
            image, H = downscaling.picture(image), H @ np.linalg.inv(downscaling.scale)
        if not self._camera.distorts and _in_front(H, size):
            return warp(image, H, size, self._interpolation, None, allocate=allocate)
        camera = self._camera.downscaled(downscaling) if downscaling.level else self._camera
        result = allocate((size[1], size[0], *image.shape[2:]), image.dtype)
        if self._interpolation == "linear" and is_resampled(image) and camera.nodes(H, size, _LOOKED_AT).gentle:
            resample_at(image, camera.nodes(H, size), result)
            return result
        where, shares = self._tables_of(camera, H, size)
        cv2.remap(image, where, shares, INTERPOLATION[self._interpolation], result, cv2.BORDER_CONSTANT)
        return result

    def _tables_of(self, camera: Camera, H: Homography, size: tuple[int, int]) -> RemapTables | QuickTables:
        of = (H.tobytes(), size)
        if self._tables is None or self._of != of:
            maps = camera.maps if self._interpolation == "nearest" else camera.quick_maps
            self._of, self._tables = of, maps(H, size)
        return self._tables


def _level(ortho_H_image: Homography, size: tuple[int, int], image_size: tuple[int, int]) -> int:
    """How often a picture is halved before it is mapped to a coarser grid, against aliasing.

    So that half of what is seen of the picture is not finer than the grid.
    """
    image_H_ortho, places = np.linalg.inv(ortho_H_image), grid(size)
    seen = places @ image_H_ortho[2, :2] + image_H_ortho[2, 2] > 0
    seen[seen] = inside(apply(image_H_ortho, places[seen]), image_size)
    if not seen.any():
        return 0
    areas = np.abs(np.linalg.det(point_jacobian(image_H_ortho, places[seen])))
    coarser = max(0, math.floor(math.log2(float(np.median(areas))) / 2))
    return min(coarser, math.floor(math.log2(min(image_size))))  # a pixel is left


def _in_front(ortho_H_image: Homography, size: tuple[int, int]) -> bool:
    """Whether the whole grid lies in front of the camera: the depth is linear, so its corners tell."""
    x, y = size[0] - 1.0, size[1] - 1.0
    depth = np.linalg.inv(ortho_H_image)[2] @ np.array([[0, x, 0, x], [0, 0, y, y], [1, 1, 1, 1.0]])
    return bool((depth > 0).all())
