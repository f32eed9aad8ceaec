"""What control points tell of a view that is taken for nadir: its place, its heading, and whether it is one.

A rigid motion takes the points as a nadir view sees them to where they are. What it leaves is not nadir: a tilt bends
the picture by up to f tan(tilt) (r / f)^2 pixels, and another height scales it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtrc

from stab_ros.core.errors import ConfigError, InputError
from stab_ros.core.types import FloatArray
from stab_ros.georeferencing.camera_fit import fit_pose
from stab_ros.georeferencing.control_points import ControlPoints
from stab_ros.georeferencing.coordinate_checks import another_reading, below_points, below_text
from stab_ros.georeferencing.point_noise import PointNoise
from stab_ros.georeferencing.settings import GeoreferenceConfig
from stab_ros.georeferencing.unit_checks import is_feet
from stab_ros.imaging.camera import Camera
from stab_ros.imaging.pose import Pose

_FITTED = 3  # place and heading
_CREDIBLE = 1e-3  # chance of residuals below which they are none of the points' noise
_LEAST_TO_FIT = 4  # points from which on a pose tells what is wrong


@dataclass(frozen=True, eq=False)
class NadirByPoints:
    """A nadir view that was placed by control points.

    Attributes:
        pose: of the camera.
        residuals_m: (N, 2), where the points are seen, less where they are.
        gsd_m: ground sampling distance.
    """

    pose: Pose
    residuals_m: FloatArray
    gsd_m: float

    @property
    def rmse_m(self) -> float:
        """Root mean square distance of the points on the ground."""
        return float(np.sqrt(np.mean(np.sum(self.residuals_m**2, axis=1))))

    @property
    def rmse_px(self) -> float:
        """The same in pixels."""
        return self.rmse_m / self.gsd_m


def nadir_by_points(camera: Camera, up_m: float, gcps: ControlPoints) -> NadirByPoints:
    """Places a nadir view.

    Args:
        camera: that took it.
        up_m: elevation of the camera in the map.
        gcps: at least two points, their pixels as taken.

    Raises:
        ConfigError: fewer points, or one not below the camera.
    """
    if len(gcps) < 2:
        raise ConfigError(f"{len(gcps)} control point tells no heading of a nadir view, there must be 2, or none")
    depth = up_m - gcps.map_m[:, 2]
    if not (depth > 0).all():
        raise ConfigError(f"control point {gcps.names[int(np.argmin(depth))]!r} at {gcps.map_m[:, 2].max():g} m is not "
                          f"below the camera at {up_m:g} m; check height_m, and that all heights have one datum")
    seen = camera.rays(gcps.image_px) * [1, -1] * depth[:, None]  # right and up in the image, m
    places = gcps.map_m[:, :2]
    a, b = seen - seen.mean(axis=0), places - places.mean(axis=0)
    turn = math.atan2(float(np.sum(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])), float(np.sum(a * b)))
    R = np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])
    east, north = places.mean(axis=0) - R @ seen.mean(axis=0)
    pose = Pose.of_angles(np.array([east, north, up_m]), turn + math.pi / 2, math.pi / 2, 0.0)
    return NadirByPoints(pose, seen @ R.T + [east, north] - places, float(np.mean(depth)) / float(camera.K[0, 0]))


def doubts_of_nadir(config: GeoreferenceConfig, camera: Camera, gcps: ControlPoints,
                    found: NadirByPoints) -> tuple[str, ...]:
    """Why the view is no nadir view from this height, one line; empty where the residuals are those of the points.

    Args:
        config: the settings.
        camera: that took it.
        gcps: the points.
        found: how they place the view.

    Raises:
        ConfigError: they fit far better if read in another way, as with east and north swapped.
    """
    sigma_m = math.hypot(config.gcp_sigma_m, config.gcp_sigma_px * found.gsd_m)
    square = float(np.sum(found.residuals_m**2)) / sigma_m**2
    if chdtrc(2 * len(gcps) - _FITTED, square) > _CREDIBLE:
        return ()
    return (f"the control points contradict a nadir view from this height by {found.rmse_px:.1f} px "
            f"({found.rmse_m:.2f} m) RMSE{_why(config, camera, gcps, found)}",)


def _why(config: GeoreferenceConfig, camera: Camera, gcps: ControlPoints, found: NadirByPoints) -> str:
    """What the points tell of the pose, where they are enough for it."""
    if len(gcps) < _LEAST_TO_FIT:
        return ""
    noise = PointNoise(config.gcp_sigma_px, config.gcp_sigma_m)
    try:
        fit = fit_pose(gcps, camera, noise=noise)
    except InputError:
        return ""
    reading = another_reading(gcps, camera.size, fit, lambda points: fit_pose(points, camera, noise=noise))
    if reading:
        raise ConfigError(f"the control points are none of a nadir view: {reading}")
    if below_points(fit):
        return f"; {below_text(fit)}"
    pose = fit.view.pose
    tilt_deg = math.degrees(math.acos(min(1.0, float(-pose.cam_R_map[2, 2]))))
    heights = [float(p.position_m[2] - np.mean(gcps.map_m[:, 2])) for p in (pose, found.pose)]
    feet = ", so that one of them is in feet, it must be in metres" if is_feet(heights[0] / heights[1]) else ""
    return (f"; they tell a tilt of {tilt_deg:.1f} degrees and a height of {heights[0]:.4g} m above them instead of "
            f"{heights[1]:.4g} m{feet}")
