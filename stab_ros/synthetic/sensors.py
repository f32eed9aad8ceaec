"""GPS and IMU on board of a synthetic flight: samples at their own rates, with noise, delay and lever arm.

    samples = measured(flight.map_pose_at, duration_s=10, model=PPK, seed=1)
    samples.position_m, samples.map_q_body, samples.geodetic(Origin())

The errors are white noise, noise with a memory (a Gauss-Markov process of first order: Gelb 1974, section 3.6) and a
bias of the attitude. The same arguments give the same numbers.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from stab_ros.core.errors import InputError
from stab_ros.core.types import FloatArray, IdArray
from stab_ros.imaging.pose import BODY_R_OPTICAL, Pose, quaternion_of
from stab_ros.synthetic.geodetic import Origin
from stab_ros.synthetic.map_frame import PosesOverTime

Vector = tuple[float, float, float]

MARGIN_S = 1.0  # sampled before the first and after the last frame, so that every frame lies between samples
FIRST_STAMP_NS = 1_000_000_000  # of frame 0
# of a camera that is fixed to the drone's body (x forward, y left, z up) looking down, with forward at the image's top
NADIR_BODY_R_OPTICAL: FloatArray = np.array([[0.0, -1, 0], [-1, 0, 0], [0, 0, -1]])
NADIR_BODY_R_OPTICAL.flags.writeable = False


@dataclass(frozen=True, eq=False)
class SensorModel:
    """A positioning and an attitude sensor.

    Attributes:
        position_rate_hz: of the positions.
        position_sigma_m: white noise, east, north and up.
        drift_sigma_m: standard deviation of the noise with a memory, east, north and up.
        drift_time_s: after which its correlation is 1 / e.
        attitude_rate_hz: of the attitudes.
        attitude_sigma_rad: white noise of rotations about the body's x, y and z.
        attitude_bias_rad: constant rotation about the same axes, applied before the noise.
        delay_s: stamps are later than the moment of measurement by it.
        lever_arm_m: antenna minus projection centre, in the body's axes.
        body_R_optical: (3, 3), rotation from the optical frame to the body; by default that of a gimbal (x along the
            view, z up).
    """

    position_rate_hz: float = 10.0
    position_sigma_m: Vector = (0.0, 0.0, 0.0)
    drift_sigma_m: Vector = (0.0, 0.0, 0.0)
    drift_time_s: float = 60.0
    attitude_rate_hz: float = 50.0
    attitude_sigma_rad: Vector = (0.0, 0.0, 0.0)
    attitude_bias_rad: Vector = (0.0, 0.0, 0.0)
    delay_s: float = 0.0
    lever_arm_m: Vector = (0.0, 0.0, 0.0)
    body_R_optical: FloatArray = field(default_factory=lambda: BODY_R_OPTICAL)

    def __post_init__(self) -> None:
        if not (self.position_rate_hz > 0 and self.attitude_rate_hz > 0 and self.drift_time_s > 0):
            raise InputError("rates and the drift time of sensors must be positive")
        if min(self.position_sigma_m + self.drift_sigma_m + self.attitude_sigma_rad) < 0:
            raise InputError("standard deviations of sensors must not be negative")

    def body_pose(self, pose: Pose) -> tuple[FloatArray, FloatArray]:
        """Position (3,) of the antenna and rotation map_R_body (3, 3) while the camera has this pose."""
        map_R_body = pose.cam_R_map.T @ self.body_R_optical.T
        return pose.position_m + map_R_body @ np.array(self.lever_arm_m), map_R_body


_DEGREE = math.pi / 180
EXACT = SensorModel()
PPK = SensorModel(position_sigma_m=(0.02, 0.02, 0.02), attitude_sigma_rad=(0.05 * _DEGREE,) * 3)
# the receiver and the gimbal of a consumer drone
CONSUMER = SensorModel(
    position_rate_hz=10.0, position_sigma_m=(0.02, 0.02, 0.03), drift_sigma_m=(0.8, 0.8, 1.2), drift_time_s=90.0,
    attitude_rate_hz=30.0, attitude_sigma_rad=(0.03 * _DEGREE,) * 3,
    attitude_bias_rad=(0.3 * _DEGREE, -0.2 * _DEGREE, 1.0 * _DEGREE), delay_s=0.15, lever_arm_m=(-0.05, 0.0, 0.18),
)


@dataclass(frozen=True, eq=False)
class SensorSamples:
    """What the sensors told.

    Attributes:
        position_stamp_ns: (n,) int64.
        position_m: (n, 3), antenna, east, north and up in the map.
        position_covariance_m2: (3, 3), of each: white noise and noise with a memory.
        attitude_stamp_ns: (m,) int64.
        map_q_body: (m, 4), quaternions x, y, z, w from the body to the map.
        attitude_covariance_rad2: (3, 3), of each, about the axes of the body: noise without bias.
    """

    position_stamp_ns: IdArray
    position_m: FloatArray
    position_covariance_m2: FloatArray
    attitude_stamp_ns: IdArray
    map_q_body: FloatArray
    attitude_covariance_rad2: FloatArray

    def geodetic(self, origin: Origin) -> FloatArray:
        """The positions as latitude and longitude, degrees, and height above the ellipsoid, m: (n, 3)."""
        return origin.to_geodetic(self.position_m)


def measured(pose_at: PosesOverTime, duration_s: float, model: SensorModel, seed: int,
             start_ns: int = FIRST_STAMP_NS) -> SensorSamples:
    """Samples from `MARGIN_S` before frame 0 until `MARGIN_S` after the last frame.

    Args:
        pose_at: pose of the camera at seconds since frame 0.
        duration_s: from frame 0 to the last frame.
        model: of the sensors.
        seed: of the noise.
        start_ns: stamp of frame 0.
    """
    at_s, turned_s = (_moments(duration_s, rate) for rate in (model.position_rate_hz, model.attitude_rate_hz))
    antenna = np.array([model.body_pose(pose_at(t))[0] for t in at_s])
    turned = np.array([model.body_pose(pose_at(t))[1] for t in turned_s])
    return SensorSamples(
        _stamps(at_s, model, start_ns), antenna + _position_noise(len(at_s), model, seed),
        np.diag(np.square(model.position_sigma_m) + np.square(model.drift_sigma_m)),
        _stamps(turned_s, model, start_ns), _with_noise(turned, model, seed),
        np.diag(np.square(model.attitude_sigma_rad)),
    )


def small_rotation(turn_rad: FloatArray) -> FloatArray:
    """Rotation (3, 3) by the vector `turn_rad` (3,) (Rodrigues)."""
    angle = float(np.linalg.norm(turn_rad))
    x, y, z = turn_rad
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + np.sinc(angle / math.pi) * cross
                      + 0.5 * np.sinc(angle / (2 * math.pi)) ** 2 * cross @ cross)


def _moments(duration_s: float, rate_hz: float) -> FloatArray:
    return np.arange(math.ceil((duration_s + 2 * MARGIN_S) * rate_hz) + 1) / rate_hz - MARGIN_S


def _stamps(at_s: FloatArray, model: SensorModel, start_ns: int) -> IdArray:
    return np.asarray(start_ns + np.rint((at_s + model.delay_s) * 1e9).astype(np.int64))


def _position_noise(n: int, model: SensorModel, seed: int) -> FloatArray:
    """(n, 3), m."""
    white = np.random.default_rng([seed, 60]).standard_normal((n, 3)) * model.position_sigma_m
    shocks = np.random.default_rng([seed, 61]).standard_normal((n, 3))
    kept = math.exp(-1 / (model.position_rate_hz * model.drift_time_s))
    drift = shocks.copy()
    for k in range(1, n):
        drift[k] = kept * drift[k - 1] + math.sqrt(1 - kept * kept) * shocks[k]
    return np.asarray(white + drift * model.drift_sigma_m)


def _with_noise(map_R_body: FloatArray, model: SensorModel, seed: int) -> FloatArray:
    """Quaternions (m, 4) of rotations (m, 3, 3), with bias and noise."""
    noise = np.random.default_rng([seed, 62]).standard_normal((len(map_R_body), 3)) * model.attitude_sigma_rad
    biased = map_R_body @ small_rotation(np.array(model.attitude_bias_rad))
    return np.array([quaternion_of(R @ small_rotation(turn)) for R, turn in zip(biased, noise, strict=True)])
