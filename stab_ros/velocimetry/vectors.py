"""Velocity vectors with the covariance of each, and what all of them share.

An error that every vector has by itself averages out over many vectors; one that they share (scale, water surface
elevation, the homography of one frame) does not. So the two are kept apart: the covariance of all velocities of an
interval is `blockdiag(covariance) + S S^T`, with `S` the rows of `shared` one below the other.

A column that stands for a frame (its homography, its stamp) is another error in each interval, see `vector_errors` and
`shared_errors`. Taken as one error over several intervals, as there are no columns for each frame of a stream, it makes
the standard deviation of a mean over them too large, and that of a difference too small.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from stab_ros.core.types import BoolArray, FloatArray, IdArray

Unit: TypeAlias = Literal["m", "px"]


@dataclass(frozen=True, eq=False)
class Vectors:
    """N velocity vectors on the water plane.

    Attributes:
        start_m: (N, 2) where each begins: east, north in the map (or x, y in pixels of the reference, see `unit`).
        end_m: (N, 2) where it ends.
        start_ns: (N,) int64, stamps of the frames between which it was measured.
        end_ns: (N,) int64.
        covariance: (N, 2, 2) of the velocity, by the error that each vector has by itself, (m/s)^2.
        shared: (N, 2, K) changes of the velocity by one standard deviation of each of K common errors, m/s; 0 where a
            vector does not have it.
        track_id: (N,) int64, unique in a stream.
        unit: of lengths, "m" or "px"; all that is named `_m` is in it.

    Raises:
        ValueError: arrays of other shapes, or an end that is not after its start.
    """

    start_m: FloatArray
    end_m: FloatArray
    start_ns: IdArray
    end_ns: IdArray
    covariance: FloatArray
    shared: FloatArray
    track_id: IdArray
    unit: Unit = "m"

    def __post_init__(self) -> None:
        n = len(self.track_id)
        shapes = self.start_m.shape, self.end_m.shape, self.start_ns.shape, self.end_ns.shape, self.covariance.shape
        if shapes != ((n, 2), (n, 2), (n,), (n,), (n, 2, 2)) or self.shared.shape[:2] != (n, 2):
            raise ValueError(f"{n} vectors with arrays of {shapes}, {self.shared.shape}")
        if not (self.end_ns > self.start_ns).all():
            raise ValueError("a vector must end after its start")

    def __len__(self) -> int:
        return len(self.track_id)

    def __getitem__(self, keep: BoolArray | IdArray | slice) -> Vectors:
        return Vectors(self.start_m[keep], self.end_m[keep], self.start_ns[keep], self.end_ns[keep],
                       self.covariance[keep], self.shared[keep], self.track_id[keep], self.unit)

    @property
    def dt_s(self) -> FloatArray:
        """(N,) time from start to end, s."""
        return (self.end_ns - self.start_ns) * 1e-9

    @property
    def position_m(self) -> FloatArray:
        """(N, 2) midway between start and end."""
        return (self.start_m + self.end_m) / 2

    @property
    def velocity_m_s(self) -> FloatArray:
        """(N, 2), m/s."""
        return (self.end_m - self.start_m) / self.dt_s[:, None]

    @property
    def total_covariance(self) -> FloatArray:
        """(N, 2, 2) of the velocity, by all errors, (m/s)^2."""
        return np.asarray(self.covariance + self.shared @ self.shared.transpose(0, 2, 1))
