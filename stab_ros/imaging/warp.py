"""A frame in the reference's place."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias

import cv2
import numpy as np

from stab_ros.core.types import Homography, Image
from stab_ros.imaging.camera import Camera
from stab_ros.imaging.resampling import is_gentle, resample
from stab_ros.imaging.window import Window

INTERPOLATION = {
    "nearest": cv2.INTER_NEAREST,
    "linear": cv2.INTER_LINEAR,
    "cubic": cv2.INTER_CUBIC,
    "lanczos": cv2.INTER_LANCZOS4,
}
Allocate: TypeAlias = Callable[[tuple[int, ...], np.dtype[Any]], Image]
_WHOLE = Window()


def warp(image: Image, ref_H_cur: Homography, size: tuple[int, int], interpolation: str, camera: Camera | None,
         window: Window = _WHOLE, allocate: Allocate = np.empty) -> Image:
    """`image` as seen from the reference of `size` (width, height): same channels and dtype, 0 beyond its border.

    With a camera whose lens distorts, distortion and homography are undone in one interpolation. window: which part of
    the reference, and how large. allocate: gives room for the result by shape and dtype.
    """
    shrinking, made_size = window.shrinking, window.size(size)
    made_H_image = window.window_H_cur(ref_H_cur)
    if shrinking.level:
        image, made_H_image = shrinking.picture(image), made_H_image @ np.linalg.inv(shrinking.scale)
    made = allocate((made_size[1], made_size[0], *image.shape[2:]), image.dtype)
    if camera is not None and camera.distorts:
        camera = camera.shrunk(shrinking) if shrinking.level else camera
        made[...] = camera.rectify(image, made_H_image, made_size, INTERPOLATION[interpolation])
    elif interpolation == "linear" and image.flags.c_contiguous and is_gentle(made_H_image, made_size):
        resample(image, made_H_image, made)
    else:
        cv2.warpPerspective(image, made_H_image, made_size, made, INTERPOLATION[interpolation], cv2.BORDER_CONSTANT)
    return made
