"""Warping of frames to the reference."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, TypeAlias

import cv2
import numpy as np

from stab_ros.core.downscale import Downscaling
from stab_ros.core.geometry import shift
from stab_ros.core.row_shifts import RowShifts
from stab_ros.core.types import Homography, Image
from stab_ros.imaging.camera import Camera
from stab_ros.imaging.resampling import is_gentle, is_resampled, resample
from stab_ros.imaging.row_maps import row_maps
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
         window: Window = _WHOLE, allocate: Allocate = np.empty, rows: RowShifts | None = None) -> Image:
    """Warps an image to the reference.

    Args:
        image: (h, w) or (h, w, channels), uint8, uint16 or float32.
        ref_H_cur: (3, 3), maps pixels of the image (undistorted, if there is a camera) to pixels of the reference.
        size: width and height of the reference, px.
        interpolation: nearest, linear, cubic or lanczos.
        camera: its lens distortion is removed in the same interpolation; None: the image is taken as it is.
        window: which part of the reference the result shows, and at which scale.
        allocate: makes the array for the result from its shape and dtype.
        rows: displacements of the image's rows, which are put back in the same interpolation; None: there are none.

    Returns:
        The image in the place of the reference: channels and dtype of `image`, 0 beyond its border.
    """
    downscaling, warped_size = window.downscaling, window.size(size)
    warped_H_image = window.window_H_cur(ref_H_cur)
    if rows is not None:
        warped = allocate((warped_size[1], warped_size[0], *image.shape[2:]), image.dtype)
        warped[...] = _warp_rows(image, warped_H_image, warped_size, INTERPOLATION[interpolation], camera, downscaling,
                                 rows)
        return warped
    if downscaling.level:
        image, warped_H_image = downscaling.picture(image), warped_H_image @ np.linalg.inv(downscaling.scale)
    warped = allocate((warped_size[1], warped_size[0], *image.shape[2:]), image.dtype)
    if camera is not None and camera.distorts:
        camera = camera.downscaled(downscaling) if downscaling.level else camera
        warped[...] = camera.rectify(image, warped_H_image, warped_size, INTERPOLATION[interpolation])
    elif interpolation == "linear" and is_resampled(image) and is_gentle(warped_H_image, warped_size):
        resample(image, warped_H_image, warped)
    else:
        cv2.warpPerspective(image, warped_H_image, warped_size, warped, INTERPOLATION[interpolation],
                            cv2.BORDER_CONSTANT)
    return warped


def _warp_rows(image: Image, warped_H_image: Homography, size: tuple[int, int], interpolation: int,
               camera: Camera | None, downscaling: Downscaling, rows: RowShifts) -> Image:
    """Warps an image whose rows were shifted; warped_H_image: of the image before it is reduced."""
    small = downscaling.picture(image) if downscaling.level else image
    if camera is None or not camera.distorts:
        x_px, y_px = row_maps(warped_H_image, rows, size, downscaling.scale)
        return np.asarray(cv2.remap(small, x_px, y_px, interpolation, borderMode=cv2.BORDER_CONSTANT))
    camera = camera.downscaled(downscaling) if downscaling.level else camera
    margin_px = math.ceil(2 * rows.most_px) + 2
    wide_H_image, wide = shift(margin_px, margin_px) @ warped_H_image, tuple(n + 2 * margin_px for n in size)
    places = row_maps(warped_H_image, rows, size, wide_H_image)
    return camera.rectify_at(small, wide_H_image @ np.linalg.inv(downscaling.scale), (wide[0], wide[1]), places,
                             interpolation)
