"""The camera as sensor_msgs/CameraInfo describes it, and the removal of its lens distortion."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from stab_ros.core.errors import InputError
from stab_ros.core.types import FloatArray, Homography, Image

# how many distortion coefficients a model may have (sensor_msgs/distortion_models.hpp)
COEFFICIENTS = {"plumb_bob": (0, 4, 5), "rational_polynomial": (8, 12, 14)}


@dataclass(frozen=True, eq=False)
class Camera:
    """K: (3, 3) float64 intrinsics, px. D: (n,) float64 distortion of `model`. size: width, height, px.

    Raises:
        InputError: K or D is not finite, a focal length is not positive, the model is unknown or D does not fit it.
    """

    K: FloatArray
    D: FloatArray
    model: str
    size: tuple[int, int]

    def __post_init__(self) -> None:
        if self.K.shape != (3, 3) or not (np.isfinite(self.K).all() and np.isfinite(self.D).all()):
            raise InputError("camera_info: K must be 3x3 and K and D finite")
        if self.K[0, 0] <= 0 or self.K[1, 1] <= 0 or tuple(self.K[2]) != (0.0, 0.0, 1.0):
            raise InputError("camera_info: K is not calibrated, it must have positive focal lengths "
                             "and a last row 0 0 1")
        if len(self.D) and len(self.D) not in COEFFICIENTS.get(self.model, ()):
            raise InputError(f"camera_info: {len(self.D)} coefficients do not fit distortion_model {self.model!r}, "
                             f"it must be one of {', '.join(COEFFICIENTS)}")

    @property
    def distorts(self) -> bool:
        return bool(np.any(self.D))

    def undistort(self, image: Image) -> Image:
        """The picture as the same camera would see it through a perfect lens (same K, same size)."""
        return self.rectify(image, np.eye(3), self.size, cv2.INTER_LINEAR) if self.distorts else image

    def rectify(self, image: Image, ref_H_cur: Homography, size: tuple[int, int], interpolation: int) -> Image:
        """Distortion removed and `ref_H_cur` applied in one interpolation, as image_proc does with our camera_info."""
        rotation = np.linalg.inv(self.K) @ ref_H_cur @ self.K
        maps = cv2.initUndistortRectifyMap(self.K, self.D, rotation, self.K, size, cv2.CV_32FC1)
        return np.asarray(cv2.remap(image, maps[0], maps[1], interpolation, borderMode=cv2.BORDER_CONSTANT))
