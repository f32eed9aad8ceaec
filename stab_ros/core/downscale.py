"""Reduced images and the conversion of homographies between full and reduced resolution."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from stab_ros.core.geometry import level_scale, normalized
from stab_ros.core.types import Gray, Homography, Image


@dataclass(frozen=True)
class Downscaling:
    """Averaging over blocks of 2^level x 2^level pixels."""

    level: int

    @staticmethod
    def to_width(gray: Gray, width_px: int) -> Downscaling:
        """The downscaling with which an image of the size of `gray` is between one and two times `width_px` wide."""
        return Downscaling(max(0, int(np.log2(max(1.0, gray.shape[1] / width_px)))))

    @property
    def scale(self) -> Homography:
        """Homography (3, 3) from full-resolution pixels to reduced ones."""
        return level_scale(self.level)

    def picture(self, image: Image) -> Image:
        """The reduced image, of the same dtype; incomplete blocks at the right and bottom are left out.

        image: (h, w) or (h, w, channels).
        """
        height, width = (n >> self.level for n in image.shape[:2])
        whole = image[: height << self.level, : width << self.level]
        return np.asarray(cv2.resize(whole, (width, height), interpolation=cv2.INTER_AREA), image.dtype)

    def small(self, H: Homography) -> Homography:
        """The homography between reduced images that corresponds to H between full-resolution images."""
        return normalized(self.scale @ H @ np.linalg.inv(self.scale))

    def whole(self, small_H: Homography) -> Homography:
        """The homography between full-resolution images that corresponds to `small_H` between reduced ones."""
        return normalized(np.linalg.inv(self.scale) @ small_H @ self.scale)
