"""Transformation models: translation, rigid, similarity, affine, projective; each group contains the previous one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stab_ros.core.geometry import apply
from stab_ros.core.types import FloatArray, Homography
from stab_ros.estimation.gauss_newton import compose

PARAMETERS = {"translation": 2, "rigid": 3, "similarity": 4, "affine": 6, "projective": 8}
MODELS = tuple(PARAMETERS)
_COINCIDENT_PX = 1e-6


def minimal_points(model: str) -> int:
    """Size of a minimal sample: the number of correspondences that determine the model, two equations each."""
    return -(-PARAMETERS[model] // 2)


@dataclass(frozen=True, eq=False)
class Basis:
    """Normalized coordinates in which the increments of a model are well conditioned (Hartley 1997).

    Attributes:
        model: one of MODELS.
        centre: (2,), px.
        radius: RMS distance of the points from the centre, px; at least 1.
    """

    model: str
    centre: FloatArray
    radius: float

    @staticmethod
    def around(model: str, points: FloatArray) -> Basis:
        """The basis for `points` (N, 2), px."""
        centre = points.mean(axis=0)
        radius = float(np.sqrt(np.mean(np.sum((points - centre) ** 2, axis=1))))
        return Basis(model, centre, max(radius, 1.0))

    def entry_jacobian(self, H: Homography) -> FloatArray:
        """Derivative (8, parameters) of h00, h01, h02, h10, h11, h12, h20, h21 by an increment composed with H."""
        tiny = 1e-4  # px; composition is nearly linear, so the central difference is exact to 1e-10
        steps = np.eye(PARAMETERS[self.model]) * tiny
        moved = [[compose(sign * step, H, self.centre, self.radius).ravel()[:8] for sign in (1, -1)] for step in steps]
        return np.stack([(ahead - back) / (2 * tiny) for ahead, back in moved], axis=1)


def design_rows(model: str, current_px: FloatArray, reference_px: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Linear equations a x = b for the entries of a model (DLT, Hartley and Zisserman 2004, eq. 4.1 with h22 = 1).

    Not for the rigid model, whose entries are not independent; see `rigid_homographies`.

    Args:
        model: one of MODELS except rigid.
        current_px: (..., N, 2).
        reference_px: (..., N, 2).

    Returns:
        a (..., 2 N, parameters) and b (..., 2 N); `homographies` converts the solutions x.
    """
    x, y = current_px[..., 0], current_px[..., 1]
    u, v = reference_px[..., 0], reference_px[..., 1]
    one, zero = np.ones_like(x), np.zeros_like(x)
    rows: tuple[tuple[FloatArray, ...], tuple[FloatArray, ...]]
    b: tuple[FloatArray, FloatArray] = (u, v)
    if model == "translation":
        rows, b = ((one, zero), (zero, one)), (u - x, v - y)
    elif model == "similarity":
        rows = ((x, -y, one, zero), (y, x, zero, one))
    elif model == "affine":
        rows = ((x, y, one, zero, zero, zero), (zero, zero, zero, x, y, one))
    else:
        rows = (
            (x, y, one, zero, zero, zero, -x * u, -y * u),
            (zero, zero, zero, x, y, one, -x * v, -y * v),
        )
    a = np.concatenate([np.stack(row, axis=-1) for row in rows], axis=-2)
    return a, np.concatenate(b, axis=-1)


def homographies(model: str, x: FloatArray) -> Homography:
    """Homographies (..., 3, 3) of the solutions x (..., parameters) of `design_rows`."""
    H = np.zeros((*x.shape[:-1], 3, 3))
    H[..., 2, 2] = 1.0
    if model == "translation":
        H[..., 0, 0] = H[..., 1, 1] = 1.0
        H[..., 0, 2], H[..., 1, 2] = x[..., 0], x[..., 1]
    elif model == "similarity":
        H[..., 0, 0] = H[..., 1, 1] = x[..., 0]
        H[..., 0, 1], H[..., 1, 0] = -x[..., 1], x[..., 1]
        H[..., 0, 2], H[..., 1, 2] = x[..., 2], x[..., 3]
    elif model == "affine":
        H[..., :2, :] = x.reshape(*x.shape[:-1], 2, 3)
    else:
        H[...] = np.concatenate([x, np.ones((*x.shape[:-1], 1))], axis=-1).reshape(*x.shape[:-1], 3, 3)
    return H


def rigid_homographies(current_px: FloatArray, reference_px: FloatArray) -> Homography:
    """Least-squares rotation and translation (..., 3, 3) from current_px (..., N, 2) to reference_px (..., N, 2).

    Closed form in two dimensions (Umeyama 1991, eq. 40 to 42 with c = 1).
    """
    mean_current, mean_reference = current_px.mean(axis=-2), reference_px.mean(axis=-2)
    p, q = current_px - mean_current[..., None, :], reference_px - mean_reference[..., None, :]
    sine = np.sum(p[..., 0] * q[..., 1] - p[..., 1] * q[..., 0], axis=-1)
    angle = np.arctan2(sine, np.sum(p * q, axis=(-2, -1)))
    H = np.zeros((*angle.shape, 3, 3))
    H[..., 0, 0] = H[..., 1, 1] = np.cos(angle)
    H[..., 0, 1], H[..., 1, 0] = -np.sin(angle), np.sin(angle)
    H[..., :2, 2] = mean_reference - np.einsum("...ij,...j->...i", H[..., :2, :2], mean_current)
    H[..., 2, 2] = 1.0
    return H


def minimal_homographies(model: str, current_px: FloatArray, reference_px: FloatArray) -> Homography:
    """Homographies (M', 3, 3) of M minimal samples, current_px and reference_px (M, n, 2), without degenerate ones.

    Two points over-determine a rigid motion, so that is a least-squares fit.
    """
    if model == "rigid":
        apart = np.ptp(current_px, axis=1).max(axis=1, initial=0)
        return rigid_homographies(current_px[apart > _COINCIDENT_PX], reference_px[apart > _COINCIDENT_PX])
    centre, scale = reference_px.reshape(-1, 2).mean(axis=0), max(float(np.ptp(reference_px)), 1.0)
    a, b = design_rows(model, (current_px - centre) / scale, (reference_px - centre) / scale)
    usable = np.abs(np.linalg.det(a)) > 1e-9
    H = homographies(model, np.linalg.solve(a[usable], b[usable][..., None])[..., 0])
    to_unit = np.array([[1, 0, -centre[0]], [0, 1, -centre[1]], [0, 0, scale]]) / scale
    H = np.linalg.inv(to_unit) @ H @ to_unit
    return H[np.abs(H[:, 2, 2]) > 1e-9] / H[np.abs(H[:, 2, 2]) > 1e-9][:, 2:, 2:]


def nearest(model: str, H: Homography, points: FloatArray) -> Homography:
    """Least-squares projection of H onto `model` over `points` (N, 2), px; H itself for the projective model."""
    if model == "projective":
        return H
    if model == "rigid":
        return rigid_homographies(points, apply(H, points))
    a, b = design_rows(model, points, apply(H, points))
    return homographies(model, np.linalg.lstsq(a, b, rcond=None)[0])
