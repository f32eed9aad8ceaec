"""What of an image lies on the water plane: pixels above the horizon are told by the sign of the depth.

Seen from above, a homography from the image (y down) to the map (north up) turns the orientation, so det(H) / w^3, the
determinant of its local Jacobian, is negative at every pixel that shows the plane. This holds whatever the scale of H,
also where pixel (0, 0), by which h22 = 1 is fixed, lies above the horizon.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from stab_ros.core.geometry import point_jacobian
from stab_ros.core.types import BoolArray, FloatArray, Homography
from stab_ros.imaging.camera import Camera

_SAMPLES = 33  # of each side of the image
_COARSEST = 10.0  # ground sampling distance, as a multiple of the finest: what is coarser is no part of the orthophoto


def in_front(map_H_image: Homography, pixels: FloatArray) -> BoolArray:
    """(N,) bool: which undistorted pixels (N, 2) lie below the horizon."""
    w = pixels @ map_H_image[2, :2] + map_H_image[2, 2]
    return np.asarray(w * np.linalg.det(map_H_image) < 0)


def with_positive_depth(ortho_H_image: Homography) -> Homography:
    """`ortho_H_image` (3, 3), scaled so that its inverse gives the depth: positive in front of the camera."""
    return np.asarray(ortho_H_image * np.sign(np.linalg.det(ortho_H_image)))


@lru_cache(maxsize=4)
def sampled_pixels(camera: Camera) -> FloatArray:
    """Undistorted pixels (n, 2), read-only, that the camera sees, in even steps over the image as taken."""
    x, y = np.meshgrid(*(np.linspace(0, n - 1, _SAMPLES) for n in camera.size))
    rays = camera.rays(np.stack([x.ravel(), y.ravel()], axis=1))
    pixels = rays @ camera.K[:2, :2].T + camera.K[:2, 2]
    seen = np.asarray(pixels[np.isfinite(pixels).all(axis=1)])
    seen.flags.writeable = False  # one camera takes all frames: its array is shared
    return seen


def gsd_m(map_H_image: Homography, pixels: FloatArray) -> FloatArray:
    """Ground sampling distance (N,) of undistorted pixels (N, 2), the longer axis of each, m; inf above the horizon."""
    seen = in_front(map_H_image, pixels)
    longest = np.full(len(pixels), np.inf)
    J = point_jacobian(map_H_image, pixels[seen])
    squares, area = np.sum(J**2, axis=(1, 2)), np.linalg.det(J)  # sum and root of the product of both axes' squares
    longest[seen] = np.sqrt((squares + np.sqrt(np.maximum(squares**2 - 4 * area**2, 0))) / 2)
    return longest


def shown_well(map_H_image: Homography, pixels: FloatArray) -> FloatArray:
    """Those of pixels (N, 2) that show the plane no more than ten times coarser than the finest, (n, 2)."""
    gsd = gsd_m(map_H_image, pixels)
    return np.asarray(pixels[np.isfinite(gsd) & (gsd <= _COARSEST * gsd.min(initial=np.inf))])
