"""A frame from the reference: the homography of the ground takes its place along, a homothety takes it to the water.

The homographies follow the ground. Where the water lies below it, a point that the camera at C sees on the ground at X
lies on the water at C + (X - C) (C_z - WSE) / (C_z - ground), along the same ray.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from stab_ros.core.geometry import normalized, product_jacobians
from stab_ros.core.types import FloatArray, Homography
from stab_ros.georeferencing.orientation import Answer, Unplaced
from stab_ros.georeferencing.place_error import PlaceError
from stab_ros.georeferencing.placement import Placement, Sighting
from stab_ros.georeferencing.plane_pose import focal_derivative, pose_derivative, pose_of_plane
from stab_ros.georeferencing.pose_link import PoseLink
from stab_ros.georeferencing.posed import not_above, placement
from stab_ros.imaging.camera import Camera
from stab_ros.imaging.pose import Pose


@dataclass(frozen=True, eq=False)
class ReferencePlace:
    """Where the reference lies on the ground.

    Attributes:
        map_H_ref: (3, 3), h22 = 1, from its undistorted pixels to east and north on the ground, m.
        spread: (8, K), changes of h00 .. h21 by one standard deviation of each of K errors, which all frames share.
        ground_m: elevation of the ground in the map.
        focal_spread: (2, K), what the same errors change of the logarithms of the focal lengths; (2, 0): known.
    """

    map_H_ref: Homography
    spread: FloatArray
    ground_m: float
    focal_spread: FloatArray = field(default_factory=lambda: np.zeros((2, 0)))


def placed_by_motion(camera: Camera, calibrated: bool, reference: ReferencePlace, sighting: Sighting,
                     values: dict[str, float], warnings: tuple[str, ...]) -> Answer:
    """The place of a frame that is registered to a placed reference.

    Args:
        camera: that took it.
        calibrated: whether its K is known; without, there is no pose, and the ground is taken for the water.
        reference: where the reference lies.
        sighting: the frame.
        values: figures for the status.
        warnings: what makes the place of the reference doubtful.
    """
    if sighting.ref_H_cur is None:
        return Unplaced("the frame is lost, there is no homography of it")
    map_H_ground = normalized(reference.map_H_ref @ sighting.ref_H_cur)
    error = _combined(reference, sighting)
    if not calibrated:
        return placement(camera, map_H_ground, error, None, None, values, warnings)
    pose = pose_of_plane(camera, map_H_ground, reference.ground_m)
    if not pose.position_m[2] > sighting.wse_m:
        return not_above(pose, sighting.wse_m)
    map_H_image, of_water = _on_water(map_H_ground, pose, reference.ground_m, sighting.wse_m)
    if error is None:
        return placement(camera, map_H_image, None, pose, None, values, warnings)
    by_ground = product_jacobians(of_water, map_H_ground)[1]
    higher, _ = _on_water(map_H_ground, pose, reference.ground_m, sighting.wse_m - 1e-4)
    by_wse = (map_H_image - higher).ravel()[:8] / 1e-4
    on_water = error.mapped(by_ground).with_shared(sighting.wse_sigma_m * by_wse)
    own, shared = _pose_error(camera, map_H_ground, reference, error)
    answer = placement(camera, map_H_image, on_water, pose, own + shared @ shared.T, values, warnings)
    if not isinstance(answer, Placement):
        return answer
    return replace(answer, pose_link=PoseLink("homographies", {"place of the reference": shared}))


def _pose_error(camera: Camera, map_H_ground: Homography, reference: ReferencePlace,
                error: PlaceError) -> tuple[FloatArray, FloatArray]:
    """Covariance (6, 6) of the error of the pose that the frame has by itself, and changes (6, K) by what is shared."""
    J = pose_derivative(camera, map_H_ground)
    shared = J @ error.shared
    if reference.focal_spread.shape[1]:
        shared = shared + focal_derivative(camera, map_H_ground, reference.ground_m) @ reference.focal_spread
    return np.asarray(J @ error.own @ J.T), shared


def _combined(reference: ReferencePlace, sighting: Sighting) -> PlaceError | None:
    """The error on the ground: the place of the reference is shared, the homography the frame's; None: unknown."""
    if sighting.covariance is None or sighting.ref_H_cur is None:
        return None
    by_place, by_motion = product_jacobians(reference.map_H_ref, sighting.ref_H_cur)
    return PlaceError(by_motion @ sighting.covariance @ by_motion.T, by_place @ reference.spread)


def _on_water(map_H_ground: Homography, pose: Pose, ground_m: float, wse_m: float) -> tuple[Homography, Homography]:
    """From pixels to the water, h22 = 1, and the homothety from the ground to it."""
    east, north, up = pose.position_m
    k = (up - wse_m) / (up - ground_m)
    homothety = np.array([[k, 0, (1 - k) * east], [0, k, (1 - k) * north], [0, 0, 1]])
    return normalized(homothety @ map_H_ground), homothety
