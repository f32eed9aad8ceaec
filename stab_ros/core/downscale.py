"""Small pictures, for a rough look, and the way between their homographies and those of the whole ones."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from stab_ros.core.geometry import level_scale, normalized
from stab_ros.core.types import Gray, Homography, Image


@dataclass(frozen=True)
class Downscaling:
    """Blocks of 2^level px a side are averaged to one px."""

    level: int

    @staticmethod
    def to_width(gray: Gray, width_px: int) -> Downscaling:
        """So that a picture like `gray` is `width_px` wide, or up to twice that."""
        return Downscaling(max(0, int(np.log2(max(1.0, gray.shape[1] / width_px)))))

    @property
    def scale(self) -> Homography:
        """From px of the whole picture to those of the small one."""
        return level_scale(self.level)

    def picture(self, image: Image) -> Image:
        """The small one; an incomplete last row or column of blocks is left out, so that `scale` holds."""
        height, width = (n >> self.level for n in image.shape[:2])
        whole = image[: height << self.level, : width << self.level]
        return np.asarray(cv2.resize(whole, (width, height), interpolation=cv2.INTER_AREA), image.dtype)

    def small(self, H: Homography) -> Homography:
        """What a homography between whole pictures is between small ones."""
        return normalized(self.scale @ H @ np.linalg.inv(self.scale))

    def whole(self, small_H: Homography) -> Homography:
        """The other way."""
        return normalized(np.linalg.inv(self.scale) @ small_H @ self.scale)
