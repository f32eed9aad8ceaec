"""`dynamic_gps_imu`: sensors place every frame, without control points (Perks 2020, section 2.2.1).

Where homographies are known too, both are fused: they tell relative motion without jitter, the sensors where it begins.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from stab_ros.core.covariance import factor
from stab_ros.core.geometry import product_jacobians
from stab_ros.core.types import FloatArray
from stab_ros.georeferencing.fusion import Fused, Fusion, FusionSettings, contradiction
from stab_ros.georeferencing.interpolation import Limits
from stab_ros.georeferencing.orientation import Answer, Unplaced
from stab_ros.georeferencing.placement import Placement, Sighting
from stab_ros.georeferencing.pose_link import PoseLink
from stab_ros.georeferencing.pose_track import Mounting, PosePrior, PoseTrack
from stab_ros.georeferencing.posed import not_above, placed
from stab_ros.georeferencing.sensor_checks import check_view
from stab_ros.georeferencing.sensor_watch import SensorWatch
from stab_ros.georeferencing.sensors import Sensors
from stab_ros.georeferencing.settings import GeoreferenceConfig, numbers_of
from stab_ros.imaging.camera import Camera
from stab_ros.imaging.pose import Pose

KnownPose = tuple[Pose, FloatArray]


@dataclass(frozen=True, eq=False)
class _Told:
    """What is told of a pose. covariance: (6, 6). warnings: one line each. innovation, link: as of `Fused`."""

    pose: Pose
    covariance: FloatArray | None
    warnings: tuple[str, ...] = ()
    innovation: float = math.nan
    link: PoseLink | None = None


class DynamicGpsImu:
    """The pose of each frame is that between the samples of the sensors before and after it."""

    needs_motion = False
    needs_sensors = True
    needs_picture = False

    def __init__(self, config: GeoreferenceConfig, camera: Camera, sensors: Sensors,
                 first: KnownPose | None = None) -> None:
        """Prepares for a stream.

        Args:
            config: the settings.
            camera: that takes the images.
            sensors: whose samples grow with the stream.
            first: pose of the first frame by control points, and its covariance (6, 6); None: there are none.
        """
        yaw, pitch, roll = numbers_of("mount_rad", config.mount_rad, 3)
        mounting = Mounting.of_angles(numbers_of("lever_arm_m", config.lever_arm_m, 3), yaw, pitch, roll)
        limits = Limits(config.sensor_timeout_s, min(Limits.extrapolation_s, config.sensor_timeout_s))
        self._config, self._camera, self._sensors, self._first = config, camera, sensors, first
        self._track = PoseTrack(sensors.positions, sensors.attitudes, mounting, limits, False, config.position_sigma_m,
                                config.attitude_sigma_rad)
        ground_m = config.wse_m + config.ground_above_wse_m
        self._fusion_settings = FusionSettings(ground_m, config.sensor_slow_share)
        self._fusion = Fusion(camera, self._fusion_settings)
        self._watch = SensorWatch(camera, self._track, ground_m, config.apply_time_offset, config.time_offset_s)
        self._left_out: tuple[str, ...] = ()  # that control points are, as they contradict the sensors
        self._contradicting: tuple[int, KnownPose] | None = None  # what they tell, and the stamp of which frame
        self._moving = False  # whether a homography has come
        self._chain = object()  # of poses by sensors alone, on one clock

    def place(self, sighting: Sighting) -> Answer:
        """Places a frame by the samples around it, and by its homography."""
        answer = self._placed(sighting)
        self._correct_clock()
        return answer

    def last_look(self) -> tuple[str, ...]:
        """See `Watching`: axes, height and clock of the sensors, also of a flight too short for a look on the way."""
        return self._watch.last_look()

    def _correct_clock(self) -> None:
        """Applies a time offset that was found from the next frame on; the filter begins anew."""
        correction_s = self._watch.taken_correction_s()
        if correction_s:
            self._sensors.shift(correction_s)
            self._fusion, self._chain = Fusion(self._camera, self._fusion_settings), object()
            self._left_out = self._still_left_out()

    def _placed(self, sighting: Sighting) -> Answer:
        self._watch.add(sighting)
        prior = self._track.pose_at(sighting.stamp_ns)
        upwards = None if isinstance(prior, Unplaced) else check_view(prior)
        if upwards is not None:
            return Unplaced(upwards)
        told = self._told(sighting, prior)
        if isinstance(told, Unplaced):
            return told if isinstance(prior, Unplaced) or prior.pose.position_m[2] > sighting.wse_m else (
                not_above(prior.pose, sighting.wse_m))
        values = self._sensors.staleness_s(sighting.stamp_ns) | self._watch.values
        if self._config.apply_time_offset:
            values["time_offset_s"] = self._sensors.time_offset_s
        if isinstance(prior, PosePrior):
            values |= {"position_interval_s": prior.position_interval_s}
        if math.isfinite(told.innovation):
            values["innovation"] = told.innovation
        answer = placed(self._camera, told.pose, told.covariance, sighting.wse_m, sighting.wse_sigma_m, values,
                        (*told.warnings, *self._left_out, *self._doubts(), *self._watch.warnings), anew=True)
        answer = _split(answer, sighting if self._moving else None)
        return replace(answer, pose_link=told.link) if isinstance(answer, Placement) else answer

    def _told(self, sighting: Sighting, prior: PosePrior | Unplaced) -> _Told | Unplaced:
        """The pose by the sensors alone, until there are homographies to fuse them with."""
        self._moving = self._moving or (self._config.fuse_homographies and sighting.ref_H_cur is not None)
        if not self._moving:
            return prior if isinstance(prior, Unplaced) else _Told(prior.pose, prior.covariance, link=self._link(prior))
        seen, self._first = self._agreeing(sighting.stamp_ns, prior), None
        fused = self._fusion.update(sighting, None if isinstance(prior, Unplaced) else prior, seen)
        if not isinstance(fused, Fused):
            return prior if isinstance(prior, Unplaced) else fused
        lost = () if isinstance(prior, PosePrior) else (f"by homographies alone: {prior.reason}",)
        return _Told(fused.pose, fused.covariance, (*fused.warnings, *lost), fused.innovation, fused.link)

    def _agreeing(self, stamp_ns: int, prior: PosePrior | Unplaced) -> KnownPose | None:
        """The pose by control points, unless it contradicts that of the sensors, which is said."""
        if self._first is None or isinstance(prior, Unplaced):
            return self._first
        self._left_out = self._contradiction(prior, self._first)
        if not self._left_out:
            return self._first
        self._contradicting = stamp_ns, self._first
        return None

    def _still_left_out(self) -> tuple[str, ...]:
        """What is said of control points after the clock was corrected, which may have been all that was wrong."""
        if self._contradicting is None:
            return ()
        stamp_ns, seen = self._contradicting
        prior = self._track.pose_at(stamp_ns)
        return self._left_out if isinstance(prior, Unplaced) else self._contradiction(prior, seen)

    def _contradiction(self, prior: PosePrior, seen: KnownPose) -> tuple[str, ...]:
        """That control points contradict the sensors, if they do, and what may be the cause, the usual first."""
        times = contradiction(prior, seen, self._fusion_settings.unlikely)
        return () if times is None else (
            f"control points and sensors contradict each other: {times:.1f} times as far apart as their sigmas say, "
            "the points are left out; check lever_arm_m, mount_rad, time_offset_s, the sigmas of the sensors "
            "(position_sigma_m and attitude_sigma_rad where they tell none), crs, origin and the datum of heights "
            "(fix_height_offset_m)",)

    def _link(self, prior: PosePrior) -> PoseLink:
        """Frames share the samples beside them, and what of all samples errs slowly."""
        slow = self._config.sensor_slow_share
        if not slow or prior.covariance is None:
            return PoseLink(self._chain, prior.by)
        white = {source: math.sqrt(1 - slow) * columns for source, columns in prior.by.items()}
        return PoseLink(self._chain, {**white, "slow errors": math.sqrt(slow) * factor(prior.covariance)})

    def _doubts(self) -> tuple[str, ...]:
        """Samples without covariance are said, as the sigma of the settings then stands for theirs."""
        positions, attitudes = self._sensors.positions, self._sensors.attitudes
        first = (("positions", "position_sigma_m", positions and positions[0].covariance_m2 is None),
                 ("attitudes", "attitude_sigma_rad", attitudes and attitudes[0].covariance_rad2 is None))
        return tuple(f"{what} come without covariance, {name} stands for it" for what, name, missing in first
                     if missing)


def _split(answer: Answer, moved: Sighting | None) -> Answer:
    """A fused pose changes slowly: only the registration of the frame is its own error. moved: None: not fused."""
    if not isinstance(answer, Placement) or answer.error is None:
        return answer
    if moved is None or moved.ref_H_cur is None or moved.covariance is None:
        return replace(answer, error=answer.error.padded(8))
    by_motion = product_jacobians(answer.map_H_image @ np.linalg.inv(moved.ref_H_cur), moved.ref_H_cur)[1]
    return replace(answer, error=answer.error.seen_by(by_motion @ moved.covariance @ by_motion.T))
