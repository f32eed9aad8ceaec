"""`dynamic_gps_imu`: sensors place every frame, without control points (Perks 2020, section 2.2.1)."""

from __future__ import annotations

from dataclasses import replace

from stab_ros.georeferencing.interpolation import Limits
from stab_ros.georeferencing.orientation import Answer, Unplaced
from stab_ros.georeferencing.placement import Placement, Sighting
from stab_ros.georeferencing.pose_track import Mounting, PoseTrack
from stab_ros.georeferencing.posed import placed
from stab_ros.georeferencing.sensors import Sensors
from stab_ros.georeferencing.settings import GeoreferenceConfig, numbers_of
from stab_ros.imaging.camera import Camera


class DynamicGpsImu:
    """The pose of each frame is that between the samples of the sensors before and after it."""

    needs_motion = False
    needs_sensors = True

    def __init__(self, config: GeoreferenceConfig, camera: Camera, sensors: Sensors) -> None:
        """Prepares for a stream.

        Args:
            config: the settings.
            camera: that takes the images.
            sensors: whose samples grow with the stream.
        """
        yaw, pitch, roll = numbers_of("mount_rad", config.mount_rad, 3)
        mounting = Mounting.of_angles(numbers_of("lever_arm_m", config.lever_arm_m, 3), yaw, pitch, roll)
        limits = Limits(config.sensor_timeout_s, min(Limits.extrapolation_s, config.sensor_timeout_s))
        self._camera, self._sensors = camera, sensors
        self._track = PoseTrack(sensors.positions, sensors.attitudes, mounting, limits, False, config.position_sigma_m,
                                config.attitude_sigma_rad)

    def place(self, sighting: Sighting) -> Answer:
        """Places a frame by the samples around it."""
        prior = self._track.pose_at(sighting.stamp_ns)
        if isinstance(prior, Unplaced):
            return prior
        answer = placed(self._camera, prior.pose, prior.covariance, sighting.wse_m, sighting.wse_sigma_m,
                        self._sensors.staleness_s(sighting.stamp_ns), self._doubts())
        return answer if isinstance(answer, Unplaced) else _with_intervals(answer, prior.position_interval_s)

    def _doubts(self) -> tuple[str, ...]:
        """Samples without covariance are said, as the sigma of the settings then stands for theirs."""
        first = (("positions", "position_sigma_m", self._sensors.positions[0].covariance_m2),
                 ("attitudes", "attitude_sigma_rad", self._sensors.attitudes[0].covariance_rad2))
        return tuple(f"{what} come without covariance, {name} stands for it" for what, name, known in first
                     if known is None)


def _with_intervals(answer: Placement, interval_s: float) -> Placement:
    return replace(answer, values={**answer.values, "position_interval_s": interval_s})
