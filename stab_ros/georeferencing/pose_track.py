"""The pose of the camera at any moment of a flight, as positions and attitudes of its sensors tell it.

The camera is at X_antenna - R_body l, l the antenna as seen from the camera, and looks as the body does, turned by its
mount. Small rotations w of the body about the axes of the map move it by -w x (R_body l).
"""

from __future__ import annotations

import math
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from stab_ros.core.covariance import factor
from stab_ros.core.errors import InputError
from stab_ros.core.types import FloatArray
from stab_ros.georeferencing.interpolation import Interpolated, Limits, attitude_at, position_at
from stab_ros.georeferencing.orientation import Unplaced
from stab_ros.georeferencing.samples import AttitudeSample, PositionSample
from stab_ros.imaging.pose import BODY_R_OPTICAL, Pose, rotation_of, rotation_of_quaternion


@dataclass(frozen=True, eq=False)
class Mounting:
    """How antenna, attitude sensor and camera are fixed to each other.

    Attributes:
        lever_arm_m: (3,), the antenna as seen from the camera, in the axes of the body (x forward, y left, z up).
        body_R_optical: (3, 3), rotation from the optical frame to the body; by default the camera looks forward, as for
            a gimbal whose attitude is that of the camera.

    Raises:
        InputError: not finite, or not a rotation.
    """

    lever_arm_m: FloatArray = field(default_factory=lambda: np.zeros(3))
    body_R_optical: FloatArray = field(default_factory=lambda: BODY_R_OPTICAL)

    def __post_init__(self) -> None:
        if self.lever_arm_m.shape != (3,) or not np.isfinite(self.lever_arm_m).all():
            raise InputError("a lever arm must be 3 finite numbers")
        Pose(np.zeros(3), self.body_R_optical)  # checks the rotation

    @staticmethod
    def of_angles(lever_arm_m: Sequence[float], yaw_rad: float, pitch_rad: float, roll_rad: float) -> Mounting:
        """The camera turned by these angles in the body: yaw 0 forward, pitch positive downwards."""
        return Mounting(np.array(lever_arm_m, float), rotation_of(yaw_rad, pitch_rad, roll_rad).T)


@dataclass(frozen=True, eq=False)
class PosePrior:
    """What sensors tell of the camera at one moment.

    Attributes:
        stamp_ns: the moment, on the clock of the frames.
        pose: of the camera.
        covariance: (6, 6) of east, north, up, m, and rotations about the axes of the map, rad; None: unknown.
        map_R_body: (3, 3), attitude of the body.
        position_interval_s: between the samples of position.
        attitude_interval_s: between the samples of attitude.
        by: changes (6, 3) of the pose by one standard deviation of the errors of each sample that counts, by what it is
            and its stamp, ns; empty where the covariance is unknown. They add up to `covariance`.
    """

    stamp_ns: int
    pose: Pose
    covariance: FloatArray | None
    map_R_body: FloatArray
    position_interval_s: float = 0.0
    attitude_interval_s: float = 0.0
    by: Mapping[Hashable, FloatArray] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class PoseTrack:
    """Poses of the camera from samples of sensors.

    Attributes:
        positions: in the order of their stamps, which are on the clock of the frames. The list may grow.
        attitudes: as positions.
        mounting: of the sensors.
        limits: how far from a sample a frame may be.
        spline: whether positions lie on a cubic through four samples, else on a line through two.
        position_sigma_m: of positions without covariance; None: the pose has no covariance then.
        attitude_sigma_rad: of attitudes without covariance; None: as above.
    """

    positions: Sequence[PositionSample]
    attitudes: Sequence[AttitudeSample]
    mounting: Mounting = field(default_factory=Mounting)
    limits: Limits = field(default_factory=Limits)
    spline: bool = False
    position_sigma_m: float | None = None
    attitude_sigma_rad: float | None = None

    def pose_at(self, stamp_ns: int) -> PosePrior | Unplaced:
        """The pose at a stamp of the frames, ns; or why it is not known, in one line."""
        position = position_at(self.positions, stamp_ns, self.limits, self.spline)
        attitude = attitude_at(self.attitudes, stamp_ns, self.limits)
        if isinstance(position, Unplaced):
            return position
        if isinstance(attitude, Unplaced):
            return attitude
        R = rotation_of_quaternion(attitude.values)
        pose = Pose(position.values - R @ self.mounting.lever_arm_m, self.mounting.body_R_optical.T @ R.T)
        return PosePrior(stamp_ns, pose, self._covariance(position, attitude, R), R, position.interval_s,
                         attitude.interval_s, self._by_samples(position, attitude, R))

    def _covariance(self, position: Interpolated, attitude: Interpolated, R: FloatArray) -> FloatArray | None:
        by_position = _known(position.covariance, self.position_sigma_m)
        in_body = _known(attitude.covariance, self.attitude_sigma_rad)
        if by_position is None or in_body is None:
            return None
        turns = R @ in_body @ R.T
        lever = cross_matrix(R @ self.mounting.lever_arm_m)  # -w x l = l x w
        return np.block([[by_position + lever @ turns @ lever.T, lever @ turns], [turns @ lever.T, turns]])

    def _by_samples(self, position: Interpolated, attitude: Interpolated, R: FloatArray) -> dict[Hashable, FloatArray]:
        """`PosePrior.by`; samples of one sensor count as equally sure."""
        by_position = _known(position.covariance, self.position_sigma_m)
        in_body = _known(attitude.covariance, self.attitude_sigma_rad)
        if by_position is None or in_body is None:
            return {}
        turns, lever = R @ factor(in_body), cross_matrix(R @ self.mounting.lever_arm_m)
        places = np.concatenate([factor(by_position), np.zeros((3, 3))])
        return _shared_out("position", position.weights, places) | _shared_out(
            "attitude", attitude.weights, np.concatenate([lever @ turns, turns]))


def repeats(before: PositionSample, sample: PositionSample, repeat_s: float = 0.5) -> bool:
    """Whether a position is the one before, given out once more: rows at 30 Hz of a fix at 10 Hz (DJI's subtitles).

    A repeated position would say that the drone stands still and then jumps. One that stays the same for longer than
    `repeat_s` is taken for measured: a drone on the ground.
    """
    soon = sample.stamp_ns - before.stamp_ns < repeat_s * 1e9
    return soon and bool(np.array_equal(before.position_m, sample.position_m))


def cross_matrix(v: FloatArray) -> FloatArray:
    """The matrix (3, 3) by which v x u = [v] u."""
    x, y, z = v
    return np.array([[0, -z, y], [z, 0, -x], [-y, x, 0.0]])


def _shared_out(what: str, weights: Mapping[int, float], columns: FloatArray) -> dict[Hashable, FloatArray]:
    """Changes (6, 3) by the errors of all samples, `columns`, as those of each of them."""
    length = math.hypot(*weights.values())
    return {(what, stamp_ns): weight / length * columns for stamp_ns, weight in weights.items()}


def _known(covariance: FloatArray | None, sigma: float | None) -> FloatArray | None:
    if covariance is not None or sigma is None:
        return covariance
    return np.asarray(sigma**2 * np.eye(3))
