"""Compiled inner loop of the estimators: iteratively reweighted Gauss-Newton on the transformation group of a model.

The generators of a model are the first `k` of tx, ty, rotation, scale, stretch, shear and two perspective terms. Their
coordinates are centred on `centre` and divided by `radius`, so that every parameter has the unit px. Each step solves
for the increment that best explains the residuals between H p and the reference points, and composes it with H, so that
H remains in the group (Baker and Matthews 2004, section 3.2). All arrays are float64.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from stab_ros.core.kernels import BOOL, F64, I64, kernel, read
from stab_ros.core.robust import MAD_TO_SIGMA
from stab_ros.core.types import BoolArray, FloatArray, Homography, IdArray

_RIGID = 3  # parameters of the rigid model
_SINGULAR = 1e-10  # smallest pivot of a matrix with a unit diagonal

_ROW, _TABLE, _STACK, _MASK = read(F64, 1), read(F64, 2), read(F64, 3), read(BOOL, 1)
_FEATURES = (_TABLE, _TABLE, _STACK)  # reference, current, metric or information
_BASIS = (_ROW, F64)  # centre, radius


@kernel((_TABLE, *_FEATURES))
def squared_residuals(H: Homography, reference: FloatArray, current: FloatArray, metric: FloatArray) -> FloatArray:
    """Squared residuals e^T metric e (N,), px^2; infinite for points behind the camera."""
    out = np.empty(len(current))
    for i in range(len(current)):
        x, y = current[i, 0], current[i, 1]
        w = H[2, 0] * x + H[2, 1] * y + H[2, 2]
        if w <= 0:
            out[i] = np.inf
            continue
        ex = reference[i, 0] - (H[0, 0] * x + H[0, 1] * y + H[0, 2]) / w
        ey = reference[i, 1] - (H[1, 0] * x + H[1, 1] * y + H[1, 2]) / w
        out[i] = ex * ex * metric[i, 0, 0] + 2 * ex * ey * metric[i, 0, 1] + ey * ey * metric[i, 1, 1]
    return out


@kernel((_ROW, F64, F64))
def look_up(table: FloatArray, ratio: float, beyond: float) -> float:
    """The table's value at `ratio` in [0, 1); `beyond` for larger ratios."""
    return table[int(ratio * (len(table) - 1))] if ratio < 1 else beyond


@kernel((_ROW, _ROW, F64))
def weights_of(ratio: FloatArray, table: FloatArray, beyond: float) -> FloatArray:
    """Values (N,) of the table at `ratio` (N,); see `look_up`."""
    out = np.empty(len(ratio))
    for i in range(len(ratio)):
        out[i] = look_up(table, ratio[i], beyond)
    return out


@kernel((_TABLE, *_FEATURES, _STACK, _ROW, _ROW, _ROW, F64))
def response(H: Homography, reference: FloatArray, current: FloatArray, information: FloatArray, metric: FloatArray,
             trust: FloatArray, limit: FloatArray, table: FloatArray, beyond: float) -> float:
    """Derivative of the sum of the scores w Omega e by a shift, as a share of what constant weights w would give.

    w = table(u) with u = e^T M e / limit, M the metric; limit: (N,) px^2. So the derivative of w Omega e by e is
    w Omega + 2 w'(u) Omega e (M e)^T / limit. Its trace counts, summed over the features.
    """
    constant, varying = 0.0, 0.0
    squared, last = squared_residuals(H, reference, current, metric), len(table) - 1
    for i in range(len(current)):
        u = squared[i] / limit[i]
        weight = trust[i] * look_up(table, u, beyond)
        constant += weight * (information[i, 0, 0] + information[i, 1, 1])
        if u >= 1:
            continue
        k = min(int(u * last), last - 1)
        slope = trust[i] * (table[k + 1] - table[k]) * last
        w = H[2, 0] * current[i, 0] + H[2, 1] * current[i, 1] + H[2, 2]
        ex = reference[i, 0] - (H[0, 0] * current[i, 0] + H[0, 1] * current[i, 1] + H[0, 2]) / w
        ey = reference[i, 1] - (H[1, 0] * current[i, 0] + H[1, 1] * current[i, 1] + H[1, 2]) / w
        mx, my = metric[i, 0, 0] * ex + metric[i, 0, 1] * ey, metric[i, 0, 1] * ex + metric[i, 1, 1] * ey
        ox = information[i, 0, 0] * ex + information[i, 0, 1] * ey
        oy = information[i, 0, 1] * ex + information[i, 1, 1] * ey
        varying += 2 * slope * (mx * ox + my * oy) / limit[i]
    return 1 + varying / constant if constant > 0 else 1.0


@kernel((_STACK, *_FEATURES, _ROW, _ROW, _ROW, F64, I64))
def least_loss(candidates: FloatArray, reference: FloatArray, current: FloatArray, metric: FloatArray,
               trust: FloatArray, noise: FloatArray, loss: FloatArray, threshold_px: float,
               octaves: int) -> tuple[int, float]:
    """Index of the (M, 3, 3) candidate with the smallest loss, weighted by `trust`, and that loss; -1 without any.

    The loss is the mean over thresholds of 1, 1/2, 1/4 ... of `threshold_px`. With a single threshold, two planes whose
    motions differ by half of it are fitted best by their average. With several, either plane has a smaller loss.
    """
    best, least = -1, np.inf
    for m in range(len(candidates)):
        squared = squared_residuals(candidates[m], reference, current, metric)
        total = 0.0
        for i in range(len(squared)):
            reach = threshold_px**2
            for _ in range(octaves):
                total += trust[i] * look_up(loss, squared[i] / (reach + noise[i]), 1.0)
                reach /= 4
        if total < least:
            best, least = m, total
    return best, least / octaves


@kernel((_TABLE, *_FEATURES, _MASK))
def median_residual(H: Homography, reference: FloatArray, current: FloatArray, metric: FloatArray,
                     chosen: BoolArray) -> float:
    """Median residual of the features `chosen`, (N,) bool, px; infinite if there are none."""
    squared = squared_residuals(H, reference, current, metric)[chosen]
    return np.sqrt(np.median(squared)) if len(squared) else np.inf


@kernel((_TABLE, *_FEATURES, _MASK))
def variances_along_best_axis(H: Homography, reference: FloatArray, current: FloatArray, information: FloatArray,
                    chosen: BoolArray) -> tuple[float, float]:
    """Robust variance of the residuals of the chosen features, and their predicted variance, px^2.

    Both along the axis of smallest uncertainty of each feature, over the more certain half of the features.
    """
    which = np.flatnonzero(chosen)
    residual_along, predicted = np.empty(len(which)), np.empty(len(which))
    for k in range(len(which)):
        i = which[k]
        xx, xy, yy = information[i, 0, 0], information[i, 0, 1], information[i, 1, 1]
        angle = np.arctan2(2 * xy, xx - yy) / 2
        w = H[2, 0] * current[i, 0] + H[2, 1] * current[i, 1] + H[2, 2]
        ex = reference[i, 0] - (H[0, 0] * current[i, 0] + H[0, 1] * current[i, 1] + H[0, 2]) / w
        ey = reference[i, 1] - (H[1, 0] * current[i, 0] + H[1, 1] * current[i, 1] + H[1, 2]) / w
        residual_along[k] = abs(ex * np.cos(angle) + ey * np.sin(angle))
        predicted[k] = 1 / ((xx + yy) / 2 + np.hypot((xx - yy) / 2, xy))
    certain = predicted <= np.median(predicted)
    return (MAD_TO_SIGMA * np.median(residual_along[certain])) ** 2, np.median(predicted[certain])


@kernel((_TABLE, *_FEATURES, _ROW, *_BASIS, I64, read(I64, 1), I64))
def accumulate(H: Homography, reference: FloatArray, current: FloatArray, information: FloatArray, weight: FloatArray,
               centre: FloatArray, radius: float, k: int, cell: IdArray,
               cells: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Normal equations of each cell of features: sums of w J^T Omega J (cells, k, k) and w J^T Omega e (cells, k).

    The third result is the predicted variance (k, k) of the sum of all of the latter, the sum of w^2 J^T Omega J. cell:
    (N,) number of the cell of each feature.
    """
    normal, right, predicted = np.zeros((cells, k, k)), np.zeros((cells, k)), np.zeros((k, k))
    along_x, along_y, weighted_x, weighted_y = np.empty(8), np.empty(8), np.empty(8), np.empty(8)
    for i in range(len(current)):
        if weight[i] <= 0:
            continue
        w = H[2, 0] * current[i, 0] + H[2, 1] * current[i, 1] + H[2, 2]
        mapped_x = (H[0, 0] * current[i, 0] + H[0, 1] * current[i, 1] + H[0, 2]) / w
        mapped_y = (H[1, 0] * current[i, 0] + H[1, 1] * current[i, 1] + H[1, 2]) / w
        x, y = (mapped_x - centre[0]) / radius, (mapped_y - centre[1]) / radius
        along_x[0], along_x[1], along_x[2], along_x[3] = 1.0, 0.0, -y, x
        along_x[4], along_x[5], along_x[6], along_x[7] = x, y, x * x, x * y
        along_y[0], along_y[1], along_y[2], along_y[3] = 0.0, 1.0, x, y
        along_y[4], along_y[5], along_y[6], along_y[7] = -y, x, x * y, y * y
        xx, xy = weight[i] * information[i, 0, 0], weight[i] * information[i, 0, 1]
        yy = weight[i] * information[i, 1, 1]
        ex, ey = reference[i, 0] - mapped_x, reference[i, 1] - mapped_y
        c = cell[i]
        for a in range(k):
            weighted_x[a] = xx * along_x[a] + xy * along_y[a]
            weighted_y[a] = xy * along_x[a] + yy * along_y[a]
            right[c, a] += weighted_x[a] * ex + weighted_y[a] * ey
            for b in range(a + 1):
                both = weighted_x[a] * along_x[b] + weighted_y[a] * along_y[b]
                normal[c, a, b] += both
                predicted[a, b] += weight[i] * both
    for a in range(k):
        for b in range(a):
            normal[:, b, a], predicted[b, a] = normal[:, a, b], predicted[a, b]
    return normal, right, predicted


@kernel((_TABLE, _ROW))
def solve(normal: FloatArray, right: FloatArray) -> tuple[bool, FloatArray]:
    """Solution (k,) by Cholesky decomposition after scaling to a unit diagonal; False where it is singular."""
    k = len(right)
    lower, x = np.zeros((k, k)), np.zeros(k)
    for a in range(k):
        if not normal[a, a] > 0:
            return False, x
    scale = 1 / np.sqrt(np.diag(normal))
    for a in range(k):
        for b in range(a + 1):
            rest = normal[a, b] * scale[a] * scale[b]
            for c in range(b):
                rest -= lower[a, c] * lower[b, c]
            if a != b:
                lower[a, b] = rest / lower[b, b]
            elif rest > _SINGULAR:
                lower[a, a] = np.sqrt(rest)
            else:
                return False, x
    for a in range(k):
        x[a] = right[a] * scale[a]
        for c in range(a):
            x[a] -= lower[a, c] * x[c]
        x[a] /= lower[a, a]
    for a in range(k - 1, -1, -1):
        for c in range(a + 1, k):
            x[a] -= lower[c, a] * x[c]
        x[a] /= lower[a, a]
    return True, x * scale


@kernel((_TABLE, _TABLE))
def product(a: FloatArray, b: FloatArray) -> FloatArray:
    """Product of two 3x3 matrices; numba's own needs scipy."""
    out = np.zeros((3, 3))
    for i in range(3):
        for j in range(3):
            out[i, j] = a[i, 0] * b[0, j] + a[i, 1] * b[1, j] + a[i, 2] * b[2, j]
    return out


@kernel((_ROW, _TABLE, *_BASIS))
def compose(delta: FloatArray, H: Homography, centre: FloatArray, radius: float) -> Any:
    """H followed by the increment `delta` (k,), px; normalized to h22 = 1.

    The rotation of a rigid increment (k = 3) is exact, because its first-order form includes a scale.
    """
    d = np.zeros(8)
    for a in range(len(delta)):
        d[a] = delta[a] / radius
    step = np.array([[1 + d[3] + d[4], d[5] - d[2], d[0]], [d[2] + d[5], 1 + d[3] - d[4], d[1]], [-d[6], -d[7], 1.0]])
    if len(delta) == _RIGID:
        step[0, 0] = step[1, 1] = np.cos(d[2])
        step[0, 1], step[1, 0] = -np.sin(d[2]), np.sin(d[2])
    to_unit = np.array([[1 / radius, 0, -centre[0] / radius], [0, 1 / radius, -centre[1] / radius], [0, 0, 1.0]])
    from_unit = np.array([[radius, 0, centre[0]], [0, radius, centre[1]], [0, 0, 1.0]])
    moved = product(from_unit, product(step, product(to_unit, H)))
    return moved / moved[2, 2]


@kernel((_TABLE, *_FEATURES, _STACK, _ROW, _ROW, _ROW, F64, F64, *_BASIS, I64, I64, F64))
def polish(H: Homography, reference: FloatArray, current: FloatArray, information: FloatArray, metric: FloatArray,
           trust: FloatArray, noise: FloatArray, table: FloatArray, beyond: float, threshold_px: float,
           centre: FloatArray, radius: float, k: int, steps: int, converged_px: float) -> tuple[bool, Homography]:
    """At most `steps` Gauss-Newton steps from H with weights from `table`; False where a step fails."""
    together = np.zeros(len(current), np.int64)
    for _ in range(steps):
        ratio = squared_residuals(H, reference, current, metric) / (threshold_px**2 + noise)
        weight = weights_of(ratio, table, beyond) * trust
        normal, right, _claimed = accumulate(H, reference, current, information, weight, centre, radius, k, together, 1)
        found, delta = solve(normal[0], right[0])
        if not found:
            return False, H
        H = compose(delta, H, centre, radius)
        if not np.all(np.isfinite(H)):
            return False, H
        if np.max(np.abs(delta)) < converged_px:
            break
    return True, H
