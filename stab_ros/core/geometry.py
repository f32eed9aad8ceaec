"""Homographies: mapping of points, distances, derivatives, uncertainty and plausibility."""

from __future__ import annotations

import functools

import numpy as np

from stab_ros.core.types import BoolArray, FloatArray, Homography

GRID = 9  # side of the evaluation grid of frame pixels: linspace(0, w-1, 9) x linspace(0, h-1, 9)


def normalized(H: Homography) -> Homography:
    """H (3, 3) scaled to h22 = 1; H itself where h22 is 0, which no plausible camera motion has."""
    return H / H[2, 2] if H[2, 2] != 0 else H


def apply(H: Homography, points: FloatArray) -> FloatArray:
    """The points (N, 2) mapped by H (3, 3): (N, 2)."""
    mapped = points @ H[:, :2].T + H[:, 2]
    return np.asarray(mapped[:, :2] / mapped[:, 2:])


@functools.cache
def grid(size: tuple[int, int]) -> FloatArray:
    """The evaluation grid of 9x9 frame pixels, (81, 2), read-only, for a frame of `size` (width, height)."""
    x, y = np.meshgrid(np.linspace(0, size[0] - 1, GRID), np.linspace(0, size[1] - 1, GRID))
    points = np.stack([x.ravel(), y.ravel()], axis=1)
    points.flags.writeable = False  # the cached array is shared
    return points


def rms_distance(H_a: Homography, H_b: Homography, size: tuple[int, int]) -> float:
    """Root mean square distance of two homographies over the 9x9 grid of the frame.

    Args:
        H_a: (3, 3), maps pixels of the frame.
        H_b: (3, 3), maps pixels of the same frame.
        size: width and height of the frame, px.

    Returns:
        The distance, px.
    """
    points = grid(size)
    return float(np.sqrt(np.mean(np.sum((apply(H_a, points) - apply(H_b, points)) ** 2, axis=1))))


def jacobian(H: Homography, points: FloatArray) -> FloatArray:
    """Derivative (N, 2, 8) of the mapped points by h00, h01, h02, h10, h11, h12, h20, h21.

    Hartley and Zisserman (2004), eq. 5.11, with h22 = 1. points: (N, 2).
    """
    mapped = apply(H, points)
    ones = np.concatenate([points, np.ones((len(points), 1))], axis=1)
    w = ones @ H[2]
    J = np.zeros((len(points), 2, 8))
    J[:, 0, 0:3] = J[:, 1, 3:6] = ones / w[:, None]
    J[:, :, 6:8] = -mapped[:, :, None] * points[:, None, :] / w[:, None, None]
    return J


def point_jacobian(H: Homography, points: FloatArray) -> FloatArray:
    """Derivative (N, 2, 2) of the mapped points by the points (N, 2)."""
    mapped, w = apply(H, points), points @ H[2, :2] + H[2, 2]
    return np.asarray((H[:2, :2] - mapped[:, :, None] * H[2, :2]) / w[:, None, None])


def product_jacobians(A: Homography, B: Homography) -> tuple[FloatArray, FloatArray]:
    """Derivatives, (8, 8) each, of h00 .. h21 of normalized(A B) by those of A and by those of B."""
    product = A @ B
    to_unit = (np.eye(9)[:8] - np.outer(product.ravel()[:8] / product[2, 2], np.eye(9)[8])) / product[2, 2]
    return to_unit @ np.kron(np.eye(3), B.T)[:, :8], to_unit @ np.kron(A, np.eye(3))[:, :8]


def sigma_px(H: Homography, covariance: FloatArray, size: tuple[int, int]) -> float:
    """Standard deviation of points mapped by H, px: RMS of sqrt(trace(J C J^T)) over the evaluation grid.

    Hartley and Zisserman (2004), section 5.2.6. covariance: C (8, 8) of h00 .. h21. size: width and height, px.
    """
    J = jacobian(H, grid(size))
    return float(np.sqrt(np.mean(np.einsum("nij,jk,nik->n", J, covariance, J))))


def shift(x_px: float, y_px: float) -> Homography:
    """The homography of a translation by (x_px, y_px)."""
    return np.array([[1.0, 0.0, x_px], [0.0, 1.0, y_px], [0.0, 0.0, 1.0]])


def level_scale(level: int) -> Homography:
    """Homography from full-resolution pixels to those of a pyramid level that averages 2x2 blocks `level` times."""
    k = 0.5**level
    return np.array([[k, 0.0, k / 2 - 0.5], [0.0, k, k / 2 - 0.5], [0.0, 0.0, 1.0]])


def inside(points: FloatArray, size: tuple[int, int]) -> BoolArray:
    """(N,) bool: which of `points` (N, 2) lie inside an image of `size` (width, height)."""
    return np.asarray(((points >= 0) & (points <= np.array(size) - 1)).all(axis=1))


def is_plausible(H: Homography, size: tuple[int, int], max_scale: float = 4.0) -> bool:
    """Whether H can be the motion of a camera over a plane: orientation-preserving, limited scale, some overlap.

    The determinant of the local Jacobian over the evaluation grid must lie in [1/max_scale^2, max_scale^2], and at
    least one of the 81 grid points must map into the reference. size: width and height of the frame, px.
    """
    if not np.isfinite(H).all():
        return False
    points = grid(size)
    w = points @ H[2, :2] + H[2, 2]
    if w.min() <= 0:
        return False
    area = np.linalg.det(H) / w**3  # determinant of the local Jacobian
    if area.min() < max_scale**-2 or area.max() > max_scale**2:
        return False
    return bool(inside(apply(H, points), size).any())


def inflated(covariance: FloatArray, ref_H_cur: Homography, variance_px2: FloatArray) -> FloatArray:
    """Covariance (8, 8) of a homography with a shift of covariance variance_px2 (2, 2)."""
    along = (np.kron(np.eye(2), ref_H_cur[2]) @ np.eye(6, 8)).T
    return np.asarray(covariance + along @ variance_px2 @ along.T)
