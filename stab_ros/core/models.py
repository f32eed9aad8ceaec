"""Transformation models: translation, similarity, affine, projective, one after the other a larger group.

Each model is a Lie group with a basis of motions v_k(p), and all its fitting is one Gauss-Newton step written once:
find the small motion sum_k delta_k v_k that best explains what is left between H p and its reference point, and
compose it with H (Baker and Matthews 2004, "Lucas-Kanade 20 years on", section 3.2, for why composing keeps H in the
group). Coordinates are centred and scaled by the caller (`Frame2D`), so that all delta_k have the unit px.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stab_ros.core.geometry import apply
from stab_ros.core.types import FloatArray, Homography

PARAMETERS = {"translation": 2, "similarity": 4, "affine": 6, "projective": 8}
MODELS = tuple(PARAMETERS)

# generators of the projective group, (8, 3, 3): tx, ty, rotation, scale, stretch, shear, two tilts
_GENERATORS = np.array(
    [
        [[0, 0, 1], [0, 0, 0], [0, 0, 0]],
        [[0, 0, 0], [0, 0, 1], [0, 0, 0]],
        [[0, -1, 0], [1, 0, 0], [0, 0, 0]],
        [[1, 0, 0], [0, 1, 0], [0, 0, 0]],
        [[1, 0, 0], [0, -1, 0], [0, 0, 0]],
        [[0, 1, 0], [1, 0, 0], [0, 0, 0]],
        [[0, 0, 0], [0, 0, 0], [-1, 0, 0]],
        [[0, 0, 0], [0, 0, 0], [0, -1, 0]],
    ],
    dtype=np.float64,
)


def minimal_points(model: str) -> int:
    """How many correspondences determine the model."""
    return PARAMETERS[model] // 2


@dataclass(frozen=True, eq=False)
class Basis:
    """The motions of a model about `centre` (2,) with points at unit distance `radius`, px."""

    model: str
    centre: FloatArray
    radius: float

    @staticmethod
    def around(model: str, points: FloatArray) -> Basis:
        """The basis in which `points` (N, 2) are well conditioned (Hartley 1997)."""
        centre = points.mean(axis=0)
        radius = float(np.sqrt(np.mean(np.sum((points - centre) ** 2, axis=1))))
        return Basis(model, centre, max(radius, 1.0))

    def motions(self, points: FloatArray) -> FloatArray:
        """How each parameter, at 1 px, moves each of `points` (N, 2): (N, 2, parameters)."""
        x, y = ((points - self.centre) / self.radius).T
        one, zero = np.ones_like(x), np.zeros_like(x)
        along_x = (one, zero, -y, x, x, y, x * x, x * y)
        along_y = (zero, one, x, y, -y, x, x * y, y * y)
        k = PARAMETERS[self.model]
        return np.stack([np.stack(along_x[:k], axis=1), np.stack(along_y[:k], axis=1)], axis=1)

    def compose(self, delta: FloatArray, H: Homography) -> Homography:
        """H followed by the small motion `delta` (parameters,), px."""
        to_unit = np.array([[1, 0, -self.centre[0]], [0, 1, -self.centre[1]], [0, 0, self.radius]]) / self.radius
        step = np.eye(3) + np.tensordot(delta / self.radius, _GENERATORS[: len(delta)], axes=1)
        moved = np.linalg.inv(to_unit) @ step @ to_unit @ H
        return np.asarray(moved / moved[2, 2])

    def entry_jacobian(self, H: Homography) -> FloatArray:
        """Derivative of h00, h01, h02, h10, h11, h12, h20, h21 of `compose(delta, H)` by delta at 0: (8, parameters)."""
        to_unit = np.array([[1, 0, -self.centre[0]], [0, 1, -self.centre[1]], [0, 0, self.radius]]) / self.radius
        unit_to = np.linalg.inv(to_unit)
        columns = []
        for generator in _GENERATORS[: PARAMETERS[self.model]] / self.radius:
            moved = unit_to @ generator @ to_unit @ H
            columns.append((moved - moved[2, 2] * H).ravel()[:8])  # H stays normalised to h22 = 1
        return np.stack(columns, axis=1)


def design_rows(model: str, current_px: FloatArray, reference_px: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The linear equations a x = b of a model's entries (DLT, Hartley and Zisserman 2004, eq. 4.1 with h22 = 1).

    current_px, reference_px: (..., N, 2). Returns a (..., 2 N, parameters) and b (..., 2 N); `entries` reads x.
    """
    x, y = current_px[..., 0], current_px[..., 1]
    u, v = reference_px[..., 0], reference_px[..., 1]
    one, zero = np.ones_like(x), np.zeros_like(x)
    if model == "translation":
        rows, b = ((one, zero), (zero, one)), (u - x, v - y)
    elif model == "similarity":
        rows, b = ((x, -y, one, zero), (y, x, zero, one)), (u, v)
    elif model == "affine":
        rows, b = ((x, y, one, zero, zero, zero), (zero, zero, zero, x, y, one)), (u, v)
    else:
        rows = (
            (x, y, one, zero, zero, zero, -x * u, -y * u),
            (zero, zero, zero, x, y, one, -x * v, -y * v),
        )
        b = (u, v)
    a = np.concatenate([np.stack(row, axis=-1) for row in rows], axis=-2)
    return a, np.concatenate(b, axis=-1)


def homographies(model: str, x: FloatArray) -> Homography:
    """The (..., 3, 3) homographies of the solutions x (..., parameters) of `design_rows`."""
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


def minimal_homographies(model: str, current_px: FloatArray, reference_px: FloatArray) -> Homography:
    """The homographies through M minimal samples, (M, n, 2) each: (M', 3, 3), degenerate samples left out."""
    centre, scale = reference_px.reshape(-1, 2).mean(axis=0), max(float(np.ptp(reference_px)), 1.0)
    a, b = design_rows(model, (current_px - centre) / scale, (reference_px - centre) / scale)
    usable = np.abs(np.linalg.det(a)) > 1e-9
    H = homographies(model, np.linalg.solve(a[usable], b[usable][..., None])[..., 0])
    to_unit = np.array([[1, 0, -centre[0]], [0, 1, -centre[1]], [0, 0, scale]]) / scale
    H = np.linalg.inv(to_unit) @ H @ to_unit
    return H[np.abs(H[:, 2, 2]) > 1e-9] / H[np.abs(H[:, 2, 2]) > 1e-9][:, 2:, 2:]


def nearest(model: str, H: Homography, points: FloatArray) -> Homography:
    """The transformation of `model` that moves `points` (N, 2) most nearly as H does; H itself if it is projective."""
    if model == "projective":
        return H
    a, b = design_rows(model, points, apply(H, points))
    return homographies(model, np.linalg.lstsq(a, b, rcond=None)[0])
