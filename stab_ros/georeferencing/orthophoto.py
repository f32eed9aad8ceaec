"""Orthophotos: one interpolation from the picture as taken, lens and homography at once."""

from __future__ import annotations

import math

import numpy as np

from stab_ros.core.downscale import Downscaling
from stab_ros.core.types import Homography, Image
from stab_ros.georeferencing.horizon import with_positive_depth
from stab_ros.imaging.camera import Camera
from stab_ros.imaging.warp import INTERPOLATION, Allocate, warp


def orthophoto(image: Image, ortho_H_image: Homography, size: tuple[int, int], camera: Camera, interpolation: str,
               allocate: Allocate = np.empty) -> Image:
    """Maps a picture to the grid of an orthophoto.

    Args:
        image: (h, w) or (h, w, channels), uint8, uint16 or float32, as taken.
        ortho_H_image: (3, 3), from undistorted pixels to those of the orthophoto.
        size: width and height of the orthophoto, px.
        camera: that took the picture.
        interpolation: nearest, linear, cubic or lanczos.
        allocate: makes the array for the result from its shape and dtype.

    Returns:
        (rows, columns) or (rows, columns, channels), the dtype of `image`; 0 where the picture shows nothing of the
        water plane, so also above the horizon.
    """
    H = with_positive_depth(ortho_H_image)
    if not camera.distorts and _in_front(H, size):
        return warp(image, H, size, interpolation, None, allocate=allocate)
    result = allocate((size[1], size[0], *image.shape[2:]), image.dtype)
    result[...] = camera.rectify(image, H, size, INTERPOLATION[interpolation])
    return result


def _in_front(ortho_H_image: Homography, size: tuple[int, int]) -> bool:
    """Whether the whole grid lies in front of the camera: the depth is linear, so its corners tell."""
    x, y = size[0] - 1.0, size[1] - 1.0
    depth = np.linalg.inv(ortho_H_image)[2] @ np.array([[0, x, 0, x], [0, 0, y, y], [1, 1, 1, 1.0]])
    return bool((depth > 0).all())


def reduction(resolution_m: float, gsd_m: float) -> Downscaling:
    """How a picture is reduced before an orthophoto coarser than it is made of it, against aliasing."""
    return Downscaling(max(0, math.floor(math.log2(resolution_m / gsd_m))))
