"""The settings of georeferencing: how frames are placed on the water plane, and the grid of the orthophotos."""

from __future__ import annotations

import math
from dataclasses import dataclass

from stab_ros.core.errors import ConfigError
from stab_ros.core.settings import Checked, setting
from stab_ros.imaging.warp import INTERPOLATION

ORIENTATIONS = ("stationary_nadir", "stationary_gcps", "dynamic_gcps", "dynamic_stabilization",
                "dynamic_gcps_stabilization", "dynamic_gps_imu")
_WITH_MOTION = ("dynamic_stabilization", "dynamic_gcps_stabilization")
WITH_GCPS = ("stationary_gcps", "dynamic_gcps", "dynamic_gcps_stabilization")


@dataclass(frozen=True)
class GeoreferenceConfig(Checked):
    """How a `Georeferencer` places frames; each field carries its range and meaning.

    Raises:
        ConfigError: a value has the wrong type or is out of range, or values contradict each other.
    """

    orientation: str = setting(
        "stationary_gcps", "How it is known where the camera is: stationary_nadir (height above the water), "
        "stationary_gcps (one fit for all frames), dynamic_gcps (control points followed in every frame), "
        "dynamic_stabilization (homographies and a known scale), dynamic_gcps_stabilization (homographies and the fit "
        "of the reference frame), dynamic_gps_imu (sensors)", choices=ORIENTATIONS)
    wse_m: float = setting(
        0.0, "Water surface elevation in metres in the map, until water_level tells another", -500.0, 9000.0)
    wse_sigma_m: float = setting(0.02, "Standard deviation of the water surface elevation in metres", 0.0, 10.0)
    height_m: float = setting(
        0.0, "Height of the camera above the water in metres (stationary_nadir, dynamic_stabilization); 0: not given",
        0.0, 9000.0)
    height_sigma_m: float = setting(0.1, "Standard deviation of height_m in metres", 0.0, 100.0)
    yaw_rad: float = setting(
        math.pi / 2, "Direction of the top of a nadir image in radians: 0 east, pi/2 north", -2 * math.pi, 2 * math.pi)
    gsd_m: float = setting(
        0.0, "Ground sampling distance of the reference frame in metres per pixel (dynamic_stabilization); 0: not "
        "given", 0.0, 100.0)
    known_distance: str = setting(
        "", "Two points of the reference frame and their distance, 'x1, y1, x2, y2, metres' in undistorted pixels "
        '(dynamic_stabilization); "": not given')
    ground_above_wse_m: float = setting(
        0.0, "Elevation of the ground that the homographies follow, in metres above wse_m", -100.0, 1000.0)
    gcp_sigma_px: float = setting(
        0.5, "Standard deviation of the marked pixels of ground control points", 0.001, 100.0)
    gcp_sigma_m: float = setting(0.02, "Standard deviation of the survey of ground control points in metres", 0.0, 10.0)
    gcp_patch_px: int = setting(
        31, "Side of the patches by which dynamic_gcps follows control points, in pixels, odd", 9, 201)
    resolution_m: float = setting(
        0.0, "Side of a pixel of the orthophoto in metres; 0: the median ground sampling distance of what the first "
        "frame shows well",
        0.0, 1000.0)
    extent: str = setting(
        "", "Borders of the orthophoto in the map, 'west, south, east, north' in metres; \"\": what the first placed "
        "frame shows")
    margin_m: float = setting(
        0.0, "Width in metres by which the orthophoto exceeds what the first placed frame shows", 0.0, 10000.0)
    interpolation: str = setting("linear", "Interpolation of the orthophoto", choices=tuple(INTERPOLATION))
    time_offset_s: float = setting(
        0.0, "Seconds to add to the stamps of positions and attitudes to get those of the frames", -3600.0, 3600.0)
    apply_time_offset: bool = setting(
        False, "Whether the time offset that dynamic_gps_imu estimates, from motion that sensors and homographies both "
        "feel, is added to time_offset_s, 10 s after the first frame and again after 30 and 90 s; else it is only told")
    lever_arm_m: str = setting(
        "0, 0, 0", "Place of the antenna as seen from the camera, 'forward, left, up' in metres in the axes of the "
        "body whose attitude is measured")
    mount_rad: str = setting(
        "0, 0, 0", "Attitude of the camera in the body whose attitude is measured, 'yaw, pitch, roll' in radians, "
        "pitch positive downwards; 0, 0, 0: the sensor turns with the camera, as that of a gimbal")
    fuse_homographies: bool = setting(
        True, "Whether dynamic_gps_imu takes homographies too, where there are any: they tell relative motion, the "
        "sensors where it begins")
    sensor_slow_share: float = setting(
        0.0, "Share of the variance of the sensors that changes slowly, over about a minute; the rest is new in each "
        "sample and averages out where homographies are fused", 0.0, 0.99)
    fix_height_offset_m: float = setting(
        0.0, "Metres to add to the heights of fixes to get those of the map: minus the undulation of the geoid for "
        "levels above the sea, the height of the place of take-off for heights above it", -1000.0, 9000.0)
    position_sigma_m: float = setting(
        3.0, "Standard deviation in metres of positions that come without one", 0.001, 1000.0)
    attitude_sigma_rad: float = setting(
        0.02, "Standard deviation in radians of attitudes that come without one", 1e-6, math.pi)
    sensor_timeout_s: float = setting(
        1.0, "Seconds from a frame to the nearest sample of a sensor, above which the frame is not placed by it",
        0.001, 3600.0)
    sensor_wait_frames: int = setting(
        60, "Number of frames that wait for the samples of sensors after them before they are placed without", 0, 10000)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.gcp_patch_px % 2 == 0:
            raise ConfigError(f"gcp_patch_px: {self.gcp_patch_px} must be odd")
        if self.known_distance and self.gsd_m:
            raise ConfigError("known_distance and gsd_m both tell the scale, give one of them")
        west, south, east, north = self.borders_m or (0.0, 0.0, 1.0, 1.0)
        if not (west < east and south < north):
            raise ConfigError(f"extent: {self.extent[:80]!r} must be west, south, east, north with west < east and "
                              "south < north")
        for name in ("lever_arm_m", "mount_rad"):
            numbers_of(name, getattr(self, name), 3)
        if self.known_distance:
            numbers_of("known_distance", self.known_distance, 5)

    @property
    def borders_m(self) -> tuple[float, ...] | None:
        """West, south, east and north of `extent`; None: what the first placed frame shows."""
        return numbers_of("extent", self.extent, 4) if self.extent.strip() else None


def needs_motion(config: GeoreferenceConfig) -> bool:
    """Whether the orientation takes homographies of frames."""
    return config.orientation in _WITH_MOTION or (config.orientation == "dynamic_gps_imu" and config.fuse_homographies)


def needs_calibration(config: GeoreferenceConfig) -> bool:
    """Whether the camera's calibration places frames: not so where the scale of the reference is given by itself."""
    by_scale = config.orientation == "dynamic_stabilization" and bool(config.gsd_m or config.known_distance)
    return not by_scale or bool(config.ground_above_wse_m)


def needs_sensors(config: GeoreferenceConfig) -> bool:
    """Whether the orientation takes positions and attitudes."""
    return config.orientation == "dynamic_gps_imu"


def needs_level(config: GeoreferenceConfig) -> bool:
    """Whether the scale depends on the water surface elevation: not so where height or scale are those above it."""
    return config.orientation not in ("stationary_nadir", "dynamic_stabilization")


def numbers_of(name: str, text: str, count: int) -> tuple[float, ...]:
    """The finite numbers of a parameter, separated by commas.

    Raises:
        ConfigError: they are not `count` finite numbers.
    """
    try:
        numbers = tuple(float(word) for word in text.strip().strip("[]").split(","))
    except ValueError:
        numbers = ()
    if len(numbers) != count or not all(map(math.isfinite, numbers)):
        raise ConfigError(f"{name}: {text[:80]!r} must be {count} numbers between commas")
    return numbers
