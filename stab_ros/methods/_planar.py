"""Small planar markers: the best whole pixel of a search area, then place, turn and size to a fraction of one.

The refinement is efficient second-order minimisation (Benhimane and Malis 2004): Gauss-Newton whose derivative is the
mean of the pattern's and of the current picture's gradient, which converges as fast as Newton's method. All markers
step together, until each of them stands.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stab_ros.core.kernels import F32, filled, kernel, read
from stab_ros.core.types import BoolArray, FloatArray, IdArray, Image
from stab_ros.methods._areas import Maps, sample

# which of the motions x, y, rotation, scale, stretch and shear about its centre a marker may make
MOTIONS = {
    "translation": (0, 1), "translation_rotation": (0, 1, 2), "translation_scale": (0, 1, 3),
    "translation_rotation_scale": (0, 1, 2, 3), "affine": (0, 1, 2, 3, 4, 5),
}
_CONVERGED_PX = 1e-3
# what the six motions, in px at the pattern's edge, add to the linear part of the map
_GENERATORS = np.array([[[0, 0], [0, 0]], [[0, 0], [0, 0]], [[0, -1], [1, 0]], [[1, 0], [0, 1]], [[1, 0], [0, -1]],
                        [[0, 1], [1, 0]]], float)


@dataclass(frozen=True, eq=False)
class Found:
    """Where N markers were found.

    maps: from the pattern to the picture. correlation: (N,) with the pattern; 0 where the marker left the picture or
    did not come to rest. structure: (N, 2, 2) of the pattern for shifts: sum of the outer products of the gradient,
    without what the other motions and a change of brightness explain as well.
    """

    maps: Maps
    correlation: FloatArray
    structure: FloatArray


def refine(image: Image, patterns: FloatArray, start: Maps, motion: str, iterations: int) -> Found:
    """The markers in a picture, from where they are about to be.

    image: (h, w) float32. patterns: (N, s + 2, s + 2) float32, with one px around the s x s of the pattern. motion: one
    of MOTIONS.
    """
    free, n, side = np.array(MOTIONS[motion]), len(patterns), patterns.shape[1]
    maps, resting = Maps(start.centres.copy(), start.shape.copy()), np.zeros(n, bool)
    correlation, structure = np.zeros(n), np.zeros((n, 2, 2))
    going = np.flatnonzero(maps.inside(image, side))
    for _ in range(iterations):
        if not len(going):
            break
        step, correlation[going], structure[going] = _step(image, patterns[going], maps[going], free)
        moved = maps[going].moved(*_motion(step, free, side - 2))
        maps.centres[going], maps.shape[going] = moved.centres, moved.shape
        resting[going] = np.abs(step).max(axis=1) < _CONVERGED_PX
        going = going[~resting[going] & (correlation[going] > 0) & moved.inside(image, side)]
    return Found(maps, np.where(resting, correlation, 0.0), structure)


def _step(image: Image, patterns: FloatArray, maps: Maps, free: IdArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """One Gauss-Newton step (N, k) px, and the correlation and structure found with it."""
    seen = sample(image, maps, patterns.shape[1]).astype(np.float64)
    pattern, there = _centred(patterns[:, 1:-1, 1:-1]), _centred(seen[:, 1:-1, 1:-1])
    power, along, variation = _dot(pattern, pattern), _dot(pattern, there), _dot(there, there)
    usable = (along > 0) & (power > 0)
    gain = np.divide(along, variation, out=np.zeros_like(along), where=usable)[:, None, None]
    steepest = _descent((patterns + gain * seen) / 2, pattern, power, free)
    residual = (pattern - gain * there).reshape(len(pattern), pattern[0].size)
    normal = np.einsum("nap,nbp->nab", steepest, steepest)
    largest = normal.max(axis=(1, 2), initial=0.0)
    covariance = np.linalg.inv(normal + (1e-6 * largest + 1e-9)[:, None, None] * np.eye(len(free)))
    step = np.einsum("nab,nbp,np->na", covariance, steepest, residual, optimize=True)
    correlation = np.divide(along, np.sqrt(power * variation), out=np.zeros_like(along), where=usable)
    return step, correlation, np.linalg.inv(covariance[:, :2, :2])


def _descent(mean_image: FloatArray, pattern: FloatArray, power: FloatArray, free: IdArray) -> FloatArray:
    """(N, k, s s) how the picture changes with each free motion, orthogonal to a constant and to the pattern."""
    gx = (mean_image[:, 1:-1, 2:] - mean_image[:, 1:-1, :-2]) / 2
    gy = (mean_image[:, 2:, 1:-1] - mean_image[:, :-2, 1:-1]) / 2
    u = _places(pattern.shape[1])
    v = u[:, None]
    motions = (gx, gy, gy * u - gx * v, gx * u + gy * v, gx * u - gy * v, gx * v + gy * u)
    steepest = np.stack([_centred(motions[a]) for a in free], axis=1)
    share = np.einsum("naij,nij->na", steepest, pattern) / np.maximum(power, 1e-9)[:, None]
    return np.asarray(steepest - share[:, :, None, None] * pattern[:, None]).reshape(*steepest.shape[:2], -1)


def _motion(step: FloatArray, free: IdArray, side: int) -> tuple[FloatArray, FloatArray]:
    """Shift (N, 2) px and gradient (N, 2, 2) of the field of steps (N, k)."""
    return step[:, :2], np.einsum("na,aij->nij", step, _GENERATORS[free]) / ((side - 1) / 2)


def _places(side: int) -> FloatArray:
    """(s,) -1 to 1 across the pattern."""
    return np.linspace(-1, 1, side)


def _centred(images: FloatArray) -> FloatArray:
    return np.asarray(images - images.mean(axis=(1, 2), keepdims=True), np.float64)


def _dot(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.asarray(np.einsum("nij,nij->n", a, b))


def best_place(patterns: FloatArray, areas: FloatArray) -> tuple[IdArray, BoolArray]:
    """Lags (N, 2) px from the middle of areas (N, s + m - 1, s + m - 1) at which patterns (N, s, s) differ least.

    By the sum of absolute differences, both about their means, so that brightness does not count. And (N,) bool: the
    lag does not lie on the border. All float32.
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
