"""From the pose of a camera to the place of its image on the water plane, with covariance."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from stab_ros.core.covariance import factor
from stab_ros.core.geometry import jacobian, normalized
from stab_ros.core.types import FloatArray, Homography
from stab_ros.georeferencing.horizon import gsd_m, in_front, sampled_pixels, shown_well
from stab_ros.georeferencing.orientation import Answer, Unplaced
from stab_ros.georeferencing.place_error import PlaceError, all_shared
from stab_ros.georeferencing.placement import Placement
from stab_ros.georeferencing.view_derivatives import by_level, by_pose
from stab_ros.imaging.camera import Camera
from stab_ros.imaging.pose import Pose
from stab_ros.imaging.view import View

HORIZON = "the horizon is in view, what lies above it is left out"


def placed(camera: Camera, pose: Pose, pose_covariance: FloatArray | None, wse_m: float, wse_sigma_m: float,
           values: Mapping[str, float], warnings: tuple[str, ...] = (), *, anew: bool = False) -> Answer:
    """The place of an image whose camera has this pose.

    Args:
        camera: that took it.
        pose: of the camera.
        pose_covariance: (6, 6), as of `Placement`; None: unknown.
        wse_m: water surface elevation in the map.
        wse_sigma_m: its standard deviation.
        values: figures for the status.
        warnings: what makes the pose doubtful.
        anew: whether the error of the pose is another one in each frame; else all frames share it.

    Returns:
        The placement; unplaced where the camera is not above the water, or sees nothing of it.
    """
    if not pose.position_m[2] > wse_m:
        return not_above(pose, wse_m)
    map_H_image = map_H_image_of(camera, pose, wse_m)
    error = None
    if pose_covariance is not None:
        J, at_wse = by_pose(View(camera, pose), wse_m), by_level(View(camera, pose), wse_m)
        of_pose = PlaceError(J @ pose_covariance @ J.T, np.zeros((8, 0))) if anew else (
            all_shared(J @ factor(pose_covariance)))
        error = of_pose.with_shared(wse_sigma_m * at_wse)
    return placement(camera, map_H_image, error, pose, pose_covariance, values, warnings)


def not_above(pose: Pose, wse_m: float) -> Unplaced:
    """Says that a camera is not above the water."""
    return Unplaced(f"the water surface at {wse_m:g} m is not below the camera at {pose.position_m[2]:g} m; "
                    "check wse_m, and that both have one height datum")


def placement(camera: Camera, map_H_image: Homography, error: PlaceError | None, pose: Pose | None,
              pose_covariance: FloatArray | None, values: Mapping[str, float], warnings: tuple[str, ...]) -> Answer:
    """The placement with its ground sampling distance and standard deviation; unplaced with all above the horizon."""
    pixels = sampled_pixels(camera)
    seen = in_front(map_H_image, pixels)
    if not seen.any():
        return Unplaced("the whole image lies above the horizon")
    well = shown_well(map_H_image, pixels)
    values = dict(values) | {"gsd_m": float(np.median(gsd_m(map_H_image, well)))}
    if error is not None:
        values["sigma_m"] = float(np.median(sigma_m(map_H_image, error.covariance, well)))
    warnings = warnings if seen.all() else (*warnings, HORIZON)
    return Placement(normalized(map_H_image), error, pose, pose_covariance, values, warnings)


def map_H_image_of(camera: Camera, pose: Pose, wse_m: float) -> Homography:
    """Homography (3, 3), h22 = 1, from undistorted pixels to east and north on the water plane, m."""
    return normalized(np.linalg.inv(View(camera, pose).image_H_map(wse_m)))


def sigma_m(map_H_image: Homography, covariance: FloatArray, pixels: FloatArray) -> FloatArray:
    """Standard deviation (N,) of the places of undistorted pixels (N, 2), root of the trace, m."""
    J = jacobian(map_H_image, pixels)
    return np.asarray(np.sqrt(np.maximum(np.sum(J @ covariance * J, axis=(1, 2)), 0)))


def turned(pose: Pose, change: FloatArray) -> Pose:
    """The pose after a small change (6,): of the position, m, and rotations about the axes of the map, rad."""
    angle = float(np.linalg.norm(change[3:]))
    axis = change[3:] / angle if angle else change[3:]
    x, y, z = axis
    skew = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    R = np.eye(3) + np.sin(angle) * skew + (1 - np.cos(angle)) * skew @ skew  # Rodrigues
    return Pose(pose.position_m + change[:3], pose.cam_R_map @ R.T)
