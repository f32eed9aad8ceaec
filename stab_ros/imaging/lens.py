"""Lens distortion with the models of sensor_msgs/distortion_models.hpp.

Each model is a radial scale, which is a function of the squared distance from the optical axis, plus small tangential,
thin-prism and tilt terms. The radial scale is tabulated once per camera, so that a map costs the same for every model.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from stab_ros.core.types import FloatArray, Homography

_MAX_RADIUS = 10.0  # distance from the optical axis, in focal lengths: 84 degrees
_REACH_SAMPLES = 20_000
_TABLE_SIZE = 16_384  # linear between them: below 0.001 px
_OUTSIDE_FACTOR = 1.5  # of the farthest corner's radius; the small terms do not move such points into the image


class Lens(NamedTuple):
    """Tabulated lens model.

    Attributes:
        scale: (n + 1,) radial scale at the squared radii i * reach2 / n.
        reach2: squared radius, in focal lengths, up to which the model is valid.
        small_terms: (6,) tangential and thin-prism coefficients p1, p2, s1, s2, s3, s4.
        pixel_M_seen: (3, 3), from the distorted ray to the pixel.
    """

    scale: FloatArray
    reach2: float
    small_terms: FloatArray
    pixel_M_seen: FloatArray

    def holds(self, ray_M_pixel: Homography, size: tuple[int, int]) -> bool:
        """Whether an image of `size` (width, height) lies completely within the valid range of the model.

        Its corners are farthest from the optical axis. ray_M_pixel: (3, 3), from its pixels to rays of the camera.
        """
        x, y = size[0] - 1.0, size[1] - 1.0
        u, v, depth = ray_M_pixel @ np.array([[0, x, 0, x], [0, 0, y, y], [1, 1, 1, 1.0]])
        return bool((depth > 0).all() and (u**2 + v**2 < self.reach2 * depth**2).all())


def make_lens(K: FloatArray, D: FloatArray, fisheye: bool, size: tuple[int, int]) -> Lens:
    """The tabulated model of a lens.

    Args:
        K: (3, 3), px.
        D: distortion coefficients in OpenCV's order, or the four of its fisheye model.
        fisheye: whether the model is equidistant.
        size: width and height of the image, px.
    """
    d = np.zeros(14)
    d[: len(D)] = D
    pixel_M_seen = np.array([[K[0, 0], 0, K[0, 2]], [0, K[1, 1], K[1, 2]], [0, 0, 1.0]])
    of_model = fisheye_scale if fisheye else rational_scale
    farthest = np.inf if d[12:].any() else _farthest_corner(K, size)  # not known for a tilted sensor
    reach = _reach(of_model, d, _OUTSIDE_FACTOR * farthest)
    scale = of_model(np.linspace(0, reach**2, _TABLE_SIZE + 1), d)
    if fisheye:
        return Lens(scale, reach**2, np.zeros(6), pixel_M_seen)
    return Lens(scale, reach**2, d[[2, 3, 8, 9, 10, 11]], pixel_M_seen @ tilt(d[12], d[13]))


def rational_scale(r2: FloatArray, d: FloatArray) -> FloatArray:
    """Radial scale of `plumb_bob` and `rational_polynomial` at r2 (n,); NaN from the first pole on."""
    above, below = (1 + r2 * (a + r2 * (b + r2 * c)) for a, b, c in ((d[0], d[1], d[4]), d[5:8]))
    sound = np.logical_and.accumulate(below > 1e-6)
    return np.asarray(np.where(sound, above, np.nan) / np.where(sound, below, 1.0))


def fisheye_scale(r2: FloatArray, d: FloatArray) -> FloatArray:
    """Radial scale of `equidistant` (Kannala and Brandt 2006) at r2 (n,)."""
    r = np.sqrt(np.maximum(r2, 1e-16))
    angle = np.arctan(r)
    a2 = angle**2
    return np.asarray(angle / r * (1 + a2 * (d[0] + a2 * (d[1] + a2 * (d[2] + a2 * d[3])))))


def _reach(of_model: Callable[[FloatArray, FloatArray], FloatArray], d: FloatArray, outside: float) -> float:
    """Radius, in focal lengths, up to which the model is valid and its points are inside the image.

    Where the distorted radius stops increasing, the model would show inner points a second time, as a ring. Points with
    a distorted radius above `outside` are outside the image.
    """
    r = np.linspace(0, _MAX_RADIUS, _REACH_SAMPLES + 1)
    seen = r * of_model(r**2, d)
    with np.errstate(invalid="ignore"):
        holds = (np.diff(seen) > 0) & (seen[1:] < outside)
    return float(_MAX_RADIUS if holds.all() else r[max(int(np.argmin(holds)), 1)])


def _farthest_corner(K: FloatArray, size: tuple[int, int]) -> float:
    """Distance of the farthest image corner from the principal point, in focal lengths."""
    x, y = (max(abs(K[i, 2]), abs(size[i] - K[i, 2])) / K[i, i] for i in range(2))
    return float(np.hypot(x, y))


def tilt(x_rad: float, y_rad: float) -> FloatArray:
    """Projection (3, 3) of the ray onto a tilted sensor (Louhichi et al. 2007), as in OpenCV."""
    (cx, sx), (cy, sy) = ((np.cos(a), np.sin(a)) for a in (x_rad, y_rad))
    about_x = np.array([[1.0, 0, 0], [0, cx, sx], [0, -sx, cx]])
    about_y = np.array([[cy, 0, -sy], [0, 1.0, 0], [sy, 0, cy]])
    turned = about_y @ about_x
    return np.asarray(np.array([[turned[2, 2], 0, -turned[0, 2]], [0, turned[2, 2], -turned[1, 2]], [0, 0, 1]])
                      @ turned)
