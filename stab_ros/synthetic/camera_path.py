"""A pinhole camera over the plane z = 0 and its path: the exact homography of every frame.

World coordinates, in m: x to the right and y to the bottom of a nominal image, z into the ground. The camera is at
z = -height and looks down. Its axes are x right, y down, z along the view; without rotation they are parallel to the
world's.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

import numpy as np

from stab_ros.core.types import FloatArray, Homography

# each coordinate oscillates by three sine waves: frequency and amplitude relative to the given ones
_WAVES = ((1.0, 1.0), (2.3, 0.3), (5.9, 0.06))


@dataclass(frozen=True)
class Pose:
    """Position of the camera, m, and its rotation about the view axis, its x axis and its y axis, degrees."""

    x_m: float = 0.0
    y_m: float = 0.0
    height_m: float = 0.0
    yaw_deg: float = 0.0
    pitch_deg: float = 0.0
    roll_deg: float = 0.0

    def __add__(self, other: Pose) -> Pose:
        return Pose(*(getattr(self, f.name) + getattr(other, f.name) for f in fields(Pose)))

    def __mul__(self, factor: float) -> Pose:
        return Pose(*(getattr(self, f.name) * factor for f in fields(Pose)))


@dataclass(frozen=True)
class Gust:
    """A sudden change of pose by `move`, smoothly over `duration_s` from `start_s` on."""

    start_s: float
    duration_s: float
    move: Pose

    def at(self, time_s: float) -> Pose:
        """The part of `move` that is completed at `time_s`."""
        done = min(max((time_s - self.start_s) / self.duration_s, 0.0), 1.0)
        return self.move * (done * done * (3 - 2 * done))


@dataclass(frozen=True)
class Motion:
    """Motion of a hovering camera: oscillation of amplitude `sway` around `sway_hz`, linear drift, and gusts."""

    sway: Pose
    sway_hz: float
    drift_per_s: Pose = Pose()
    gusts: tuple[Gust, ...] = ()

    def at(self, time_s: float, seed: int) -> Pose:
        """Deviation from the nominal pose at `time_s`; `seed` selects the phases."""
        moved = self.drift_per_s * time_s + self._sway(time_s, seed)
        for gust in self.gusts:
            moved = moved + gust.at(time_s)
        return moved

    def _sway(self, time_s: float, seed: int) -> Pose:
        names = [f.name for f in fields(Pose)]
        phases = np.random.default_rng([seed, 1]).uniform(0, 2 * math.pi, (len(names), len(_WAVES)))
        spread = np.random.default_rng([seed, 2]).uniform(0.8, 1.25, len(names))  # a frequency for each coordinate
        values = []
        for name, phase, own in zip(names, phases, spread, strict=True):
            angle = 2 * math.pi * self.sway_hz * own * time_s
            wave = math.fsum(a * math.sin(f * angle + p) for (f, a), p in zip(_WAVES, phase, strict=True))
            values.append(getattr(self.sway, name) * wave)
        return Pose(*values)


@dataclass(frozen=True)
class PinholeCamera:
    """A camera without distortion, with the principal point in the image centre.

    Attributes:
        size: width and height, px.
        focal_px: focal length.
    """

    size: tuple[int, int]
    focal_px: float

    @property
    def K(self) -> FloatArray:
        """Intrinsic matrix (3, 3), px."""
        width, height = self.size
        return np.array([[self.focal_px, 0, (width - 1) / 2], [0, self.focal_px, (height - 1) / 2], [0, 0, 1.0]])

    def image_H_plane(self, pose: Pose) -> Homography:
        """Homography K R [e1 e2 -C] from ground points (x, y), m, to pixels (Hartley and Zisserman 2004, eq. 8.1)."""
        centre = np.array([pose.x_m, pose.y_m, -pose.height_m])
        return product(self.K, product(rotation(pose), np.column_stack([np.eye(3)[:, :2], -centre])))


def rotation(pose: Pose) -> FloatArray:
    """Rotation (3, 3) from world to camera axes: yaw about the view axis, then pitch about x, then roll about y."""
    (cy, sy), (cp, sp), (cr, sr) = (
        (math.cos(math.radians(a)), math.sin(math.radians(a))) for a in (pose.yaw_deg, pose.pitch_deg, pose.roll_deg)
    )
    yaw = np.array([[cy, sy, 0], [-sy, cy, 0], [0, 0, 1.0]])
    pitch = np.array([[1.0, 0, 0], [0, cp, sp], [0, -sp, cp]])
    roll = np.array([[cr, 0, -sr], [0, 1.0, 0], [sr, 0, cr]])
    return product(roll, product(pitch, yaw))


def product(A: FloatArray, B: FloatArray) -> FloatArray:
    """A B of (3, 3) matrices, bit-identical on every machine; BLAS and numpy do not fix the order of summation."""
    return np.asarray(A[:, :1] * B[:1] + A[:, 1:2] * B[1:2] + A[:, 2:] * B[2:])


def inverse(A: FloatArray) -> FloatArray:
    """Inverse of a (3, 3) matrix by its cofactors, bit-identical on every machine."""
    cofactors = np.stack([np.cross(A[1], A[2]), np.cross(A[2], A[0]), np.cross(A[0], A[1])], axis=1)
    a, b, c = A[0] * cofactors[:, 0]
    return np.asarray(cofactors / (a + b + c))
