"""A camera with a pose: from points of the map to pixels, and from pixels to the water plane.

Pixels are those of the image as taken, with its distortion; `undistorted` ones are those of `Camera.undistort`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stab_ros.core.errors import InputError
from stab_ros.core.types import FloatArray, Homography
from stab_ros.imaging.camera import Camera
from stab_ros.imaging.pose import Pose

_HORIZON = 1e-3  # sine of the angle below the horizon from which on a ray reaches the plane
_BORDER_POINTS = 16  # of each side of the footprint


@dataclass(frozen=True, eq=False)
class View:
    """A posed camera over the water plane."""

    camera: Camera
    pose: Pose

    def project(self, points_m: FloatArray) -> FloatArray:
        """Pixels of points of the map.

        Args:
            points_m: (N, 3), m.

        Returns:
            (N, 2), px; NaN behind the camera and beyond what its lens model covers. They may lie outside the image.
        """
        in_camera = self.pose.to_camera(points_m)
        depth = in_camera[:, 2:]
        rays = np.where(depth > 0, in_camera[:, :2] / np.where(depth > 0, depth, 1), np.nan)
        return self.camera.pixels(rays)

    def to_plane(self, pixels: FloatArray, wse_m: float) -> FloatArray:
        """Points of the plane z = WSE that are seen at pixels.

        Args:
            pixels: (N, 2), px.
            wse_m: water surface elevation in the map, m.

        Returns:
            (N, 2), east and north, m; NaN at the horizon and above it.

        Raises:
            InputError: the camera is not above the plane.
        """
        rays = self.camera.rays(pixels)
        directions = np.column_stack([rays, np.ones(len(rays))]) @ self.pose.cam_R_map
        down = directions[:, 2] / np.linalg.norm(directions, axis=1)
        reaches = down < -_HORIZON
        distance = -self.height_m(wse_m) / np.where(reaches, directions[:, 2], -1)
        ground = self.pose.position_m[:2] + directions[:, :2] * distance[:, None]
        return np.asarray(np.where(reaches[:, None], ground, np.nan))

    def height_m(self, wse_m: float) -> float:
        """Height of the camera above the water, m.

        Raises:
            InputError: the camera is not above it.
        """
        height = float(self.pose.position_m[2] - wse_m)
        if not height > 0:
            raise InputError(f"the water surface at {wse_m:g} m is not below the camera at "
                             f"{self.pose.position_m[2]:g} m")
        return height

    def image_H_map(self, wse_m: float) -> Homography:
        """Homography (3, 3), h22 free, from east and north, m, on the plane z = WSE to undistorted pixels.

        Hartley and Zisserman (2004), eq. 8.1. Its third row gives the depth: negative behind the camera.
        """
        R, offset = self.pose.cam_R_map, np.append(-self.pose.position_m[:2], -self.height_m(wse_m))
        return np.asarray(self.camera.K @ np.column_stack([R[:, :2], R @ offset]))

    def gsd_m(self, pixels: FloatArray, wse_m: float) -> FloatArray:
        """Ground sampling distance: the longer axis of a pixel on the plane.

        Args:
            pixels: (N, 2), px.
            wse_m: water surface elevation in the map, m.

        Returns:
            (N,), m per px; NaN at the horizon and above it.
        """
        steps = 0.5 * np.eye(2)
        ends = [(self.to_plane(pixels + step, wse_m), self.to_plane(pixels - step, wse_m)) for step in steps]
        J = np.stack([after - before for after, before in ends], axis=2)
        seen = np.asarray(np.isfinite(J).all(axis=(1, 2)))
        longest = np.linalg.norm(np.where(seen[:, None, None], J, 0), ord=2, axis=(1, 2))
        return np.asarray(np.where(seen, longest, np.nan))

    def footprint_m(self, wse_m: float) -> FloatArray:
        """Outline (n, 2) of what the image shows of the plane, east and north, m, without what is above the horizon."""
        ground = self.to_plane(_border(self.camera.size), wse_m)
        return np.asarray(ground[np.isfinite(ground).all(axis=1)])


def _border(size: tuple[int, int]) -> FloatArray:
    """Pixels (n, 2) along the border of an image, clockwise from the top left."""
    t, (x, y) = np.linspace(0, 1, _BORDER_POINTS, endpoint=False), (size[0] - 1.0, size[1] - 1.0)
    sides = [(t * x, 0 * t), (0 * t + x, t * y), (x - t * x, 0 * t + y), (0 * t, y - t * y)]
    return np.concatenate([np.column_stack(side) for side in sides])
