"""Points through a lens: from rays to where they are seen, and back, without the tables of `lens_maps`.

Rays and what is seen of them are (x / z, y / z) of the camera's axes, in focal lengths.
"""

from __future__ import annotations

import numpy as np

from stab_ros.core.types import FloatArray
from stab_ros.imaging.lens import Lens, fisheye_scale, rational_scale, tilt

_NEWTON_STEPS = 12
_STEP = 1e-6  # of the numerical derivative, focal lengths
_CONVERGED = 1e-11  # focal lengths: 1e-7 px


def seen_rays(rays: FloatArray, D: FloatArray, fisheye: bool) -> FloatArray:
    """Where rays are seen (OpenCV's rational model with tangential, thin-prism and tilt terms, or its fisheye model).

    Args:
        rays: (N, 2), undistorted.
        D: distortion coefficients in OpenCV's order, or the four of its fisheye model.
        fisheye: whether the model is equidistant.

    Returns:
        (N, 2), distorted; wrong, without a word, beyond the range in which the model is valid (`Lens.reach2`).
    """
    d = np.zeros(14)
    d[: len(D)] = D
    u, v = rays.T
    r2 = u * u + v * v
    if fisheye:
        return rays * fisheye_scale(r2, d)[:, None]
    radial, uv = rational_scale(r2, d), 2 * u * v
    p1, p2, s1, s2, s3, s4 = d[[2, 3, 8, 9, 10, 11]]
    x = u * radial + p1 * uv + p2 * (r2 + 2 * u * u) + r2 * (s1 + s2 * r2)
    y = v * radial + p2 * uv + p1 * (r2 + 2 * v * v) + r2 * (s3 + s4 * r2)
    tilted = np.column_stack([x, y, np.ones_like(x)]) @ tilt(d[12], d[13]).T
    return np.asarray(tilted[:, :2] / tilted[:, 2:])


def undistorted_rays(seen: FloatArray, D: FloatArray, fisheye: bool, lens: Lens) -> FloatArray:
    """The rays that are seen at these places, by Newton's method from the inverse of the radial scale.

    Args:
        seen: (N, 2), distorted.
        D: as for `seen_rays`.
        fisheye: as for `seen_rays`.
        lens: of the same coefficients; it tells how far the model is valid.

    Returns:
        (N, 2), undistorted; NaN where no ray within the valid range is seen there.
    """
    rays = _radially_undistorted(seen, lens)
    for _ in range(_NEWTON_STEPS):
        error = seen_rays(rays, D, fisheye) - seen
        if np.nanmax(np.abs(error), initial=0) < _CONVERGED:
            break
        rays = rays - _solved(_derivative(rays, D, fisheye), error)
    error = np.abs(seen_rays(rays, D, fisheye) - seen).max(axis=1, initial=0)
    sound = (error < 1e3 * _CONVERGED) & (np.sum(rays**2, axis=1) < lens.reach2)
    return np.asarray(np.where(sound[:, None], rays, np.nan))


def _radially_undistorted(seen: FloatArray, lens: Lens) -> FloatArray:
    squared = np.linspace(0, lens.reach2, len(lens.scale))
    radius = np.sqrt(squared)
    at = np.linalg.norm(seen, axis=1)
    found = np.interp(at, radius * lens.scale, radius)
    return np.asarray(seen * np.where(at > 0, found / np.maximum(at, 1e-300), 1.0)[:, None])


def _derivative(rays: FloatArray, D: FloatArray, fisheye: bool) -> FloatArray:
    """(N, 2, 2) of what is seen by the rays, by central differences."""
    steps = _STEP * np.eye(2)
    return np.stack([(seen_rays(rays + step, D, fisheye) - seen_rays(rays - step, D, fisheye)) / (2 * _STEP)
                     for step in steps], axis=2)


def _solved(A: FloatArray, b: FloatArray) -> FloatArray:
    """X (N, 2) of A x = b for (N, 2, 2) A; 0 where A is singular or not finite."""
    determinant = A[:, 0, 0] * A[:, 1, 1] - A[:, 0, 1] * A[:, 1, 0]
    x = np.column_stack([A[:, 1, 1] * b[:, 0] - A[:, 0, 1] * b[:, 1], A[:, 0, 0] * b[:, 1] - A[:, 1, 0] * b[:, 0]])
    sound = np.isfinite(determinant) & (np.abs(determinant) > 1e-12) & np.isfinite(x).all(axis=1)
    return np.asarray(np.where(sound[:, None], x, 0) / np.where(sound, determinant, 1)[:, None])
