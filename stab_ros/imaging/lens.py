"""Lens distortion with the models of sensor_msgs/distortion_models.hpp.

Each model is a radial scale, which is a function of the squared distance from the optical axis, plus small tangential,
thin-prism and tilt terms. The radial scale is tabulated once per camera, so that a map costs the same for every model.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, TypeAlias

import numpy as np

from stab_ros.core.kernels import F32, F64, filled, kernel, read
from stab_ros.core.types import FloatArray, Homography

RemapTables: TypeAlias = tuple[FloatArray, FloatArray]  # x and y, (h, w) float32, for cv2.remap

_MAX_RADIUS = 10.0  # distance from the optical axis, in focal lengths: 84 degrees
_REACH_SAMPLES = 20_000
_TABLE_SIZE = 16_384  # linear between them: below 0.001 px
_OUTSIDE_FACTOR = 1.5  # of the farthest corner's radius; the small terms do not move such points into the image
_INVALID_PX = np.float32(-1e6)  # outside every image


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


def lens_maps(lens: Lens, ray_M_pixel: Homography, size: tuple[int, int]) -> RemapTables:
    """Positions in the distorted image of each pixel of a result; far outside the image where there is none.

    Args:
        lens: tabulated model.
        ray_M_pixel: (3, 3), from pixels of the result to rays of the camera.
        size: width and height of the result, px.
    """
    x_px, y_px = np.empty((size[1], size[0]), np.float32), np.empty((size[1], size[0]), np.float32)
    _fill_maps(lens.scale, lens.reach2, lens.small_terms, lens.pixel_M_seen, ray_M_pixel, x_px, y_px)
    return x_px, y_px


@kernel((read(F64, 1), F64, read(F64, 1), read(F64, 2), read(F64, 2), filled(F32, 2), filled(F32, 2)), fastmath=True)
def _fill_maps(scale: FloatArray, reach2: float, small_terms: FloatArray, M: FloatArray, A: Homography,
               x_px: FloatArray, y_px: FloatArray) -> None:
    """Fills the maps. scale, reach2, small_terms, M: of the lens. A: from pixels of the result to rays."""
    p1, p2, s1, s2, s3, s4 = small_terms
    entries = (len(scale) - 1) / reach2
    for row in range(len(x_px)):
        for column in range(x_px.shape[1]):
            depth = A[2, 0] * column + A[2, 1] * row + A[2, 2]
            k = 1 / max(depth, 1e-9)
            u = (A[0, 0] * column + A[0, 1] * row + A[0, 2]) * k
            v = (A[1, 0] * column + A[1, 1] * row + A[1, 2]) * k
            r2 = u * u + v * v
            seen = (depth > 1e-9) & (r2 < reach2)
            at = r2 * entries if seen else 0.0
            entry = int(at)
            radial = scale[entry] + (at - entry) * (scale[entry + 1] - scale[entry])
            uv = 2 * u * v
            x = u * radial + p1 * uv + p2 * (r2 + 2 * u * u) + r2 * (s1 + s2 * r2)
            y = v * radial + p2 * uv + p1 * (r2 + 2 * v * v) + r2 * (s3 + s4 * r2)
            w = 1 / (M[2, 0] * x + M[2, 1] * y + M[2, 2])
            x_px[row, column] = (M[0, 0] * x + M[0, 1] * y + M[0, 2]) * w if seen else _INVALID_PX
            y_px[row, column] = (M[1, 0] * x + M[1, 1] * y + M[1, 2]) * w if seen else _INVALID_PX
