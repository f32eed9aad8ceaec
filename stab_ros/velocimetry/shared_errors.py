"""What errors of homographies, and of the clock, do to the velocities of a field: errors that all vectors share.

A change of a homography moves the places of the plane by a field `point_jacobian(E, x) dE` with eight parameters, the
same eight for each frame: `plane_H_image + dH = (I + dE) plane_H_image`. So covariances of different frames can be
summed as covariances of dE, however differently the frames were taken (Hartley and Zisserman 2004, section 5.2).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stab_ros.core.covariance import factor
from stab_ros.core.geometry import apply, jacobian, normalized, product_jacobians
from stab_ros.core.types import FloatArray, Homography, IdArray
from stab_ros.velocimetry.placed_frame import PlacedFrame


@dataclass(frozen=True, eq=False)
class PlaneErrors:
    """The errors of one frame's place, as changes dE (8,) of the plane in coordinates of about -1 to 1.

    Attributes:
        covariance: (8, 8) of dE, of what the frame has by itself.
        shared: (8, K) changes of dE by what all frames share, by one standard deviation each.
    """

    covariance: FloatArray
    shared: FloatArray

    @property
    def columns(self) -> int:
        """Number of columns of `ErrorModel.columns`."""
        return int(self.shared.shape[1]) + len(self.shared) + 1


@dataclass(frozen=True, eq=False)
class Measured:
    """How velocities were measured: as weighted sums of displacements between pairs of frames.

    Attributes:
        pairs: (P, 2) int64, the frames of each pair, the earlier first.
        weights: (P,) sum 1: the share of each pair in the velocity.
        dt_s: (P,) from the first frame to the second.
        earlier: (N, 2) places in the first frame of a pair, of N vectors.
        later: (N, 2) in the second.
    """

    pairs: IdArray
    weights: FloatArray
    dt_s: FloatArray
    earlier: FloatArray
    later: FloatArray


class ErrorModel:
    """Propagates the errors of frames to velocities measured in a part of the plane."""

    def __init__(self, outline: FloatArray) -> None:
        """outline: (n, 2), of the part of the plane."""
        low, high = outline.min(axis=0), outline.max(axis=0)
        self._scale = 2 / max(float((high - low).max()), 1e-9)
        middle = (low + high) / 2
        self._unit_H_plane: Homography = np.array([[self._scale, 0, -self._scale * middle[0]],
                                                   [0, self._scale, -self._scale * middle[1]], [0, 0, 1]])

    def of(self, frame: PlacedFrame) -> PlaneErrors:
        """The errors of a frame as changes of the plane."""
        unit_H_image = normalized(self._unit_H_plane @ frame.plane_H_image)
        by_plane = product_jacobians(self._unit_H_plane, frame.plane_H_image)[1]
        by_change = product_jacobians(np.eye(3), unit_H_image)[0]
        change = np.linalg.solve(by_change, by_plane)
        return PlaneErrors(change @ frame.covariance @ change.T, change @ frame.shared)

    def columns(self, frames: Sequence[PlaneErrors], measured: Measured, velocity: FloatArray,
                clock_sigma: float = 0.0, stamp_sigma_s: float = 0.0) -> FloatArray:
        """Columns (N, 2, K + 9) of `Vectors.shared`: what the frames share, their homographies (8), the time base.

        The weights of a frame that ends one pair and begins another cancel in part: of a chain of pairs only its two
        ends count.

        Args:
            frames: errors of the frames that `measured.pairs` names.
            measured: how the velocities were measured.
            velocity: (N, 2).
            clock_sigma: relative standard deviation of the clock's rate.
            stamp_sigma_s: standard deviation of each stamp.
        """
        per_s = measured.weights / measured.dt_s
        begins, ends = (np.bincount(measured.pairs[:, k], per_s, minlength=len(frames)) for k in (0, 1))
        own = self._field((measured.earlier + measured.later) / 2) @ factor(
            np.einsum("f,fij->ij", (ends - begins) ** 2, np.stack([one.covariance for one in frames])))
        shared = np.stack([one.shared for one in frames])
        common = (self._field(measured.later) @ np.einsum("f,fik->ik", ends, shared)
                  - self._field(measured.earlier) @ np.einsum("f,fik->ik", begins, shared))
        time = velocity * np.hypot(clock_sigma, stamp_sigma_s * np.linalg.norm(ends - begins))
        return np.concatenate([common, own, time[:, :, None]], axis=2)

    def _field(self, places: FloatArray) -> FloatArray:
        """Derivatives (N, 2, 8) of places (N, 2) on the plane by dE."""
        return jacobian(np.eye(3), apply(self._unit_H_plane, places)) / self._scale
