"""A frame as velocimetry takes it: its gray image, and where its pixels lie on the water plane."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from stab_ros.core.geometry import apply
from stab_ros.core.types import FloatArray, Gray, Homography
from stab_ros.imaging.camera import Camera


@dataclass(frozen=True, eq=False)
class PlacedFrame:
    """One frame of a stream.

    Attributes:
        stamp_ns: when the image was taken.
        gray: (h, w) uint8, as taken, stabilised or an orthophoto.
        plane_H_image: (3, 3), h22 = 1, from undistorted pixels of `gray` to the water plane, in the unit of `Vectors`.
        covariance: (8, 8) of h00 .. h21 of `plane_H_image`, of the error that this frame has by itself.
        shared: (8, K) changes of h00 .. h21 by one standard deviation of each of K errors that all frames of a stream
            share (camera, water surface elevation, placement of the reference).
        camera: whose lens distortion `gray` has; None: it has none.
        epoch: frames of different epochs have no common reference: no vector spans two of them.
    """

    stamp_ns: int
    gray: Gray
    plane_H_image: Homography
    covariance: FloatArray
    shared: FloatArray = field(default_factory=lambda: np.zeros((8, 0)))
    camera: Camera | None = None
    epoch: int = 0

    def __post_init__(self) -> None:
        shapes = self.plane_H_image.shape, self.covariance.shape, self.shared.shape[:1]
        if self.gray.ndim != 2 or shapes != ((3, 3), (8, 8), (8,)):
            raise ValueError(f"a placed frame with arrays of {self.gray.shape}, {shapes}")

    def to_plane(self, pixels: FloatArray) -> FloatArray:
        """Places (N, 2) on the plane of undistorted pixels (N, 2)."""
        return apply(self.plane_H_image, pixels)
