"""Alignment of small planar markers: an exhaustive integer search, then a sub-pixel refinement of an affine motion.

The refinement is efficient second-order minimization (ESM, Benhimane and Malis 2004): Gauss-Newton with the mean of the
template gradient and the current image's gradient, which converges as fast as Newton's method. All markers iterate
together until each has converged.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stab_ros.core.kernels import F32, filled, kernel, read
from stab_ros.core.types import BoolArray, FloatArray, IdArray, Image
from stab_ros.methods._affine_windows import AffineMaps, sample

# which of the parameters x, y, rotation, scale, stretch and shear (about the marker's centre) each model has
MOTIONS = {
    "translation": (0, 1), "translation_rotation": (0, 1, 2), "translation_scale": (0, 1, 3),
    "translation_rotation_scale": (0, 1, 2, 3), "affine": (0, 1, 2, 3, 4, 5),
}
_CONVERGED_PX = 1e-3
# generators: what the six parameters, in px at the template's edge, add to the linear part of the map
_GENERATORS = np.array([[[0, 0], [0, 0]], [[0, 0], [0, 0]], [[0, -1], [1, 0]], [[1, 0], [0, 1]], [[1, 0], [0, -1]],
                        [[0, 1], [1, 0]]], float)


@dataclass(frozen=True, eq=False)
class AlignedMarkers:
    """Result of aligning N markers.

    Attributes:
        maps: from template to image coordinates.
        correlation: (N,) correlation with the template; 0 where a marker left the image or did not converge.
        structure: (N, 2, 2) structure tensor of the translation, grey levels^2 per px^2, after projecting out the
            other parameters and a change of brightness.
    """

    maps: AffineMaps
    correlation: FloatArray
    structure: FloatArray


def refine(image: Image, patterns: FloatArray, start: AffineMaps, motion: str, iterations: int) -> AlignedMarkers:
    """Aligns markers to an image, starting from `start`.

    Args:
        image: (h, w) float32.
        patterns: (N, s + 2, s + 2) float32, the s x s templates with a border of one px.
        start: initial maps.
        motion: motion model, one of MOTIONS.
        iterations: largest number of Gauss-Newton steps.
    """
    free, n, side = np.array(MOTIONS[motion]), len(patterns), patterns.shape[1]
    maps, converged = AffineMaps(start.centres.copy(), start.linear.copy()), np.zeros(n, bool)
    correlation, structure = np.zeros(n), np.zeros((n, 2, 2))
    active = np.flatnonzero(maps.inside(image, side))
    for _ in range(iterations):
        if not len(active):
            break
        step, correlation[active], structure[active] = _step(image, patterns[active], maps[active], free)
        moved = maps[active].displaced(*_displacement_field(step, free, side - 2))
        maps.centres[active], maps.linear[active] = moved.centres, moved.linear
        converged[active] = np.abs(step).max(axis=1) < _CONVERGED_PX
        active = active[~converged[active] & (correlation[active] > 0) & moved.inside(image, side)]
    return AlignedMarkers(maps, np.where(converged, correlation, 0.0), structure)


def _step(image: Image, patterns: FloatArray, maps: AffineMaps,
          free: IdArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """One Gauss-Newton step (N, k), px, with the correlation and the structure tensor at the current maps."""
    seen = sample(image, maps, patterns.shape[1]).astype(np.float64)
    pattern, there = _centred(patterns[:, 1:-1, 1:-1]), _centred(seen[:, 1:-1, 1:-1])
    power, along, variation = _dot(pattern, pattern), _dot(pattern, there), _dot(there, there)
    usable = (along > 0) & (power > 0)
    gain = np.divide(along, variation, out=np.zeros_like(along), where=usable)[:, None, None]
    steepest = _steepest_descent((patterns + gain * seen) / 2, pattern, power, free)
    residual = (pattern - gain * there).reshape(len(pattern), pattern[0].size)
    normal = np.einsum("nap,nbp->nab", steepest, steepest)
    largest = normal.max(axis=(1, 2), initial=0.0)
    covariance = np.linalg.inv(normal + (1e-6 * largest + 1e-9)[:, None, None] * np.eye(len(free)))
    step = np.einsum("nab,nbp,np->na", covariance, steepest, residual, optimize=True)
    correlation = np.divide(along, np.sqrt(power * variation), out=np.zeros_like(along), where=usable)
    return step, correlation, np.linalg.inv(covariance[:, :2, :2])


def _steepest_descent(mean_image: FloatArray, pattern: FloatArray, power: FloatArray, free: IdArray) -> FloatArray:
    """Steepest descent images (N, k, s s) of the free parameters, orthogonal to a constant and to the template."""
    gx = (mean_image[:, 1:-1, 2:] - mean_image[:, 1:-1, :-2]) / 2
    gy = (mean_image[:, 2:, 1:-1] - mean_image[:, :-2, 1:-1]) / 2
    u = _normalized_coordinates(pattern.shape[1])
    v = u[:, None]
    motions = (gx, gy, gy * u - gx * v, gx * u + gy * v, gx * u - gy * v, gx * v + gy * u)
    steepest = np.stack([_centred(motions[a]) for a in free], axis=1)
    share = np.einsum("naij,nij->na", steepest, pattern) / np.maximum(power, 1e-9)[:, None]
    return np.asarray(steepest - share[:, :, None, None] * pattern[:, None]).reshape(*steepest.shape[:2], -1)


def _displacement_field(step: FloatArray, free: IdArray, side: int) -> tuple[FloatArray, FloatArray]:
    """Translation (N, 2), px, and gradient (N, 2, 2) of the displacement field of steps (N, k)."""
    return step[:, :2], np.einsum("na,aij->nij", step, _GENERATORS[free]) / ((side - 1) / 2)


def _normalized_coordinates(side: int) -> FloatArray:
    """(s,) coordinates from -1 to 1 across the template."""
    return np.linspace(-1, 1, side)


def _centred(images: FloatArray) -> FloatArray:
    return np.asarray(images - images.mean(axis=(1, 2), keepdims=True), np.float64)


def _dot(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.asarray(np.einsum("nij,nij->n", a, b))


def best_lag(patterns: FloatArray, areas: FloatArray) -> tuple[IdArray, BoolArray]:
    """Integer displacement of each template within its search area by the zero-mean sum of absolute differences.

    Args:
        patterns: (N, s, s) float32 templates.
        areas: (N, s + m - 1, s + m - 1) float32 search areas.

    Returns:
        Lags (N, 2) int64 from the centre of the area, px, and (N,) bool: whether the lag is not on the border.
    """
    n, lags = len(patterns), areas.shape[1] - patterns.shape[1] + 1
    scores = np.zeros((n, lags, lags), np.float32)
    _absolute_differences(patterns, patterns.mean(axis=(1, 2)), areas, scores)
    y, x = np.divmod(scores.reshape(n, lags**2).argmin(axis=1), lags)
    lag = np.stack([x, y], axis=1) - lags // 2
    return lag, np.asarray(np.abs(lag).max(axis=1, initial=0) < max(lags // 2, 1))


@kernel((read(F32, 3), read(F32, 1), read(F32, 3), filled(F32, 3)), fastmath=True)
def _absolute_differences(patterns: FloatArray, means: FloatArray, areas: FloatArray, scores: FloatArray) -> None:
    n, lags, _ = scores.shape
    side = patterns.shape[1]
    for i in range(n):
        for dy in range(lags):
            for dx in range(lags):
                total, difference = np.float32(0), np.float32(0)
                for row in range(side):
                    line = areas[i, row + dy, dx : dx + side]
                    for column in range(side):
                        total += line[column]
                offset = total / np.float32(side * side) - means[i]
                for row in range(side):
                    line, ahead = areas[i, row + dy, dx : dx + side], patterns[i, row]
                    for column in range(side):
                        difference += abs(line[column] - ahead[column] - offset)
                scores[i, dy, dx] = difference
