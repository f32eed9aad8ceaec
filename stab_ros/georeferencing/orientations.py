"""The orientations by name."""

from __future__ import annotations

from typing import TypeAlias

from stab_ros.core.errors import ConfigError
from stab_ros.core.types import FloatArray
from stab_ros.georeferencing.control_points import ControlPoints
from stab_ros.georeferencing.dynamic_gcps import DynamicGcps
from stab_ros.georeferencing.dynamic_gcps_stabilization import DynamicGcpsStabilization
from stab_ros.georeferencing.dynamic_gps_imu import DynamicGpsImu
from stab_ros.georeferencing.dynamic_stabilization import DynamicStabilization
from stab_ros.georeferencing.gcp_fit import GcpFit, fit_gcps
from stab_ros.georeferencing.orientation import Orientation
from stab_ros.georeferencing.sensors import Sensors
from stab_ros.georeferencing.settings import WITH_GCPS, GeoreferenceConfig
from stab_ros.georeferencing.stationary_gcps import StationaryGcps, StationaryPose
from stab_ros.georeferencing.stationary_nadir import StationaryNadir
from stab_ros.imaging.camera import Camera
from stab_ros.imaging.pose import Pose

KnownPose: TypeAlias = tuple[Pose, FloatArray | None]


def make_orientation(config: GeoreferenceConfig, camera: Camera, calibrated: bool,
                     gcps: ControlPoints | None = None, sensors: Sensors | None = None,
                     pose: KnownPose | None = None) -> Orientation:
    """The orientation of the settings.

    Args:
        config: the settings.
        camera: that takes the images.
        calibrated: whether its K is known.
        gcps: ground control points, in the map; None: there are none.
        sensors: that the orientation may take; None: none.
        pose: of the camera in the first frame, where it is known without points, and its covariance.

    Raises:
        InputError: it needs what is not given.
    """
    if config.orientation in WITH_GCPS:
        if gcps is None and pose is not None and config.orientation == "stationary_gcps":
            return StationaryPose(camera, *pose)
        if gcps is None:
            raise ConfigError(f"{config.orientation} needs ground control points, give them as gcps_file")
        return _with_gcps(config, fit_gcps(config, camera, calibrated, gcps))
    if config.orientation == "dynamic_stabilization":
        return DynamicStabilization(config, camera, calibrated)
    if not calibrated:
        raise ConfigError(f"{config.orientation} needs the calibration of the camera, give it as camera_file, or with "
                          "a topic camera_info")
    if config.orientation == "stationary_nadir":
        return StationaryNadir(config, camera, gcps)
    first = None if gcps is None else fit_gcps(config, camera, calibrated, gcps).pose
    return DynamicGpsImu(config, camera, sensors or Sensors(config.time_offset_s), first)


def _with_gcps(config: GeoreferenceConfig, found: GcpFit) -> Orientation:
    if config.orientation == "dynamic_gcps":
        return DynamicGcps(config, found)
    if config.orientation == "dynamic_gcps_stabilization":
        return DynamicGcpsStabilization(config, found)
    return StationaryGcps(found)
