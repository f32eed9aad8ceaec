"""The most likely displacement and deformation of windows, and the covariance of the displacement.

With the response R, the Gram matrix G of the filters and the noise variance s^2 of a product, the change x that is most
likely under the prior N(0, P) of the deformation c solves (R + L) x = -products - L c with L = s^2 tr G / tr R P^-1,
and has the covariance (R + L)^-1 (s^2 G + L P L) (R + L)^-T.
"""

from __future__ import annotations

import numpy as np

from stab_ros.core.kernels import F64, I64, filled, inlined, kernel, read
from stab_ros.core.types import FloatArray, IdArray


@kernel((read(I64, 1), read(F64, 3), read(F64, 3), read(F64, 2), read(F64, 1), read(F64, 2), read(F64, 2),
         filled(F64, 2), filled(F64, 3)))
def solve(chosen: IdArray, response: FloatArray, gram: FloatArray, products: FloatArray, noise: FloatArray,
          bent: FloatArray, variance: FloatArray, change: FloatArray, spread: FloatArray) -> None:
    """Fills the last two arrays, of n chosen windows; they stay 0 where nothing was seen (noise 0).

    Args:
        chosen: (n,) which of the windows.
        response: (N, 12, 12), see `windows.Windows`.
        gram: (N, 12, 12).
        products: (n, 12), see `windows.Seen`.
        noise: (n,), s^2.
        bent: (n, 12), c so far, px.
        variance: (n, 12), P; not used for the two constants.
        change: (n, 12), x, px.
        spread: (n, 2, 2), covariance of the two constants, px^2.
    """
    size = 12
    A, weight, right, inverse = np.empty((size, size)), np.empty(size), np.empty((size, 1)), np.empty((size, 2))
    for i in range(len(chosen)):
        R, G = response[chosen[i]], gram[chosen[i]]
        scale = np.trace(R) / size
        if noise[i] <= 0 or scale <= 0:
            continue
        for a in range(size):
            weight[a] = 0.0 if a % 6 == 0 else noise[i] * np.trace(G) / (scale * size) / variance[i, a]
            right[a, 0] = -products[i, a] - weight[a] * bent[i, a]
            inverse[a, 0], inverse[a, 1] = 1.0 if a == 0 else 0.0, 1.0 if a == 6 else 0.0
        _regular(R, weight, scale, A)
        _eliminate(A, right)
        _regular(R.T, weight, scale, A)
        _eliminate(A, inverse)  # two rows of the inverse, as columns of that of the transpose
        change[i] = right[:, 0]
        for a in range(2):
            for b in range(2):
                spread[i, a, b] = _between(inverse[:, a], inverse[:, b], G, noise[i], weight, variance[i])


@inlined()
def _regular(R: FloatArray, weight: FloatArray, scale: float, A: FloatArray) -> None:
    """Fills A with R + diag(weight), and a ridge that keeps it regular."""
    for a in range(12):
        for b in range(12):
            A[a, b] = R[a, b]
        A[a, a] += weight[a] + 1e-5 * scale


@inlined()
def _eliminate(A: FloatArray, right: FloatArray) -> None:
    """Solves A x = right in place, by Gaussian elimination with pivots."""
    size = len(A)
    for k in range(size):
        best = k
        for a in range(k + 1, size):
            if abs(A[a, k]) > abs(A[best, k]):
                best = a
        for b in range(size):
            A[k, b], A[best, b] = A[best, b], A[k, b]
        for c in range(right.shape[1]):
            right[k, c], right[best, c] = right[best, c], right[k, c]
        for a in range(k + 1, size):
            factor = A[a, k] / A[k, k]
            for b in range(k, size):
                A[a, b] -= factor * A[k, b]
            for c in range(right.shape[1]):
                right[a, c] -= factor * right[k, c]
    for a in range(size - 1, -1, -1):
        for c in range(right.shape[1]):
            for b in range(a + 1, size):
                right[a, c] -= A[a, b] * right[b, c]
            right[a, c] /= A[a, a]


@inlined()
def _between(one: FloatArray, other: FloatArray, G: FloatArray, noise: float, weight: FloatArray,
             variance: FloatArray) -> float:
    """one^T (noise G + L P L) other."""
    total = 0.0
    for a in range(12):
        for b in range(12):
            total += one[a] * noise * G[a, b] * other[b]
        total += one[a] * weight[a] * weight[a] * variance[a] * other[a]
    return total
