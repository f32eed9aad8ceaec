"""How well control points are known, in the picture and on the ground."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stab_ros.core.errors import InputError
from stab_ros.core.types import FloatArray

ASSUMED_PX = 1.0  # standard deviation of a pixel coordinate where neither the user nor the residuals tell it


@dataclass(frozen=True)
class PointNoise:
    """Standard deviations of each coordinate of a control point.

    Attributes:
        image_px: of x and of y; None: not known. The residuals then tell the scale of all noise, as the a posteriori
            variance factor of an adjustment does.
        ground_m: of east, north and up.

    Raises:
        InputError: not a positive number of pixels, or a negative number of metres.
    """

    image_px: float | None = None
    ground_m: float = 0.0

    def __post_init__(self) -> None:
        if self.image_px is not None and not 0 < self.image_px < np.inf:
            raise InputError(f"the noise of points in the picture, {self.image_px:g} px, must be above 0")
        if not 0 <= self.ground_m < np.inf:
            raise InputError(f"the noise of points on the ground, {self.ground_m:g} m, must be 0 or above")

    def whitening(self, pixel_J_ground: FloatArray) -> FloatArray:
        """W (N, 2, 2) such that W r has unit covariance for residuals r, px.

        Args:
            pixel_J_ground: (N, 2, 3), derivative of the pixels by the places on the ground, px per m.
        """
        image_px = ASSUMED_PX if self.image_px is None else self.image_px
        covariance = self.ground_m**2 * pixel_J_ground @ np.swapaxes(pixel_J_ground, 1, 2) + image_px**2 * np.eye(2)
        return np.asarray(np.linalg.inv(np.linalg.cholesky(covariance)))
