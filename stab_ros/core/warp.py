"""A frame in the reference's place."""

from __future__ import annotations

import cv2
import numpy as np

from stab_ros.core.camera import Camera
from stab_ros.core.types import Homography, Image

INTERPOLATION = {
    "nearest": cv2.INTER_NEAREST,
    "linear": cv2.INTER_LINEAR,
    "cubic": cv2.INTER_CUBIC,
    "lanczos": cv2.INTER_LANCZOS4,
}


def warp(image: Image, ref_H_cur: Homography, size: tuple[int, int], interpolation: str,
         camera: Camera | None) -> Image:
    """`image` as seen from the reference: of `size` (width, height), same channels and dtype, 0 beyond its border.

    With a camera whose lens distorts, distortion and homography are undone in one interpolation.
    """
    if camera is not None and camera.distorts:
        return camera.rectify(image, ref_H_cur, size, INTERPOLATION[interpolation])
    return np.asarray(cv2.warpPerspective(image, ref_H_cur, size, flags=INTERPOLATION[interpolation],
                                          borderMode=cv2.BORDER_CONSTANT))
