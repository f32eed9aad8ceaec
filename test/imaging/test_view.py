"""Poses and views against the formulas of the literature, OpenCV and each other."""

import math

import cv2
import numpy as np
import pytest

from stab_ros.core.errors import InputError
from stab_ros.core.geometry import apply
from stab_ros.core.types import FloatArray
from stab_ros.imaging.camera import Camera
from stab_ros.imaging.pose import BODY_R_OPTICAL, Pose, quaternion_of, rotation_of, rotation_of_quaternion
from stab_ros.imaging.view import View

SIZE = (1920, 1080)
K = np.array([[1500.0, 0, 959.5], [0, 1510, 539.5], [0, 0, 1]])
RATIONAL = np.array([-0.2, 0.06, 1e-3, -5e-4, 0.01, 0.1, 0.02, 0.001])
LENSES = {
    "pinhole": Camera(K, np.zeros(5), "plumb_bob", SIZE),
    "plumb_bob": Camera(K, np.array([-0.12, 0.03, 1e-3, -8e-4, 0.002]), "plumb_bob", SIZE),
    "rational": Camera(K, RATIONAL, "rational_polynomial", SIZE),
    "prism": Camera(K, np.append(RATIONAL, [1e-3, -2e-4, 5e-4, 1e-4]), "rational_polynomial", SIZE),
    "tilt": Camera(K, np.append(RATIONAL, [1e-3, -2e-4, 5e-4, 1e-4, 0.01, -0.02]), "rational_polynomial", SIZE),
    "fisheye": Camera(K, np.array([0.02, -0.01, 0.003, -0.001]), "equidistant", SIZE),
}
ANGLES = [(0.3, 0.7, 0.1), (-2.8, 1.2, -0.4), (math.pi / 2, 0.4, 3.0), (0.0, math.pi / 2, 0.0), (1.1, math.pi / 2, 0.0)]


def imgraft_rotation(yaw: float, pitch: float, roll: float) -> FloatArray:
    """As camera.m of ImGRAFT writes it."""
    C1, C2, C3 = math.cos(yaw), math.cos(pitch), math.cos(roll)
    S1, S2, S3 = math.sin(yaw), math.sin(pitch), math.sin(roll)
    return np.array([[-1.0], [-1], [1]]) * [[S3 * S2 * C1 - C3 * S1, S3 * S2 * S1 + C3 * C1, S3 * C2],
                                              [C3 * S2 * C1 + S3 * S1, C3 * S2 * S1 - S3 * C1, C3 * C2],
                                              [C2 * C1, C2 * S1, -S2]]


@pytest.mark.parametrize("angles", ANGLES)
def test_rotation_is_that_of_imgraft(angles: tuple[float, float, float]) -> None:
    assert np.allclose(rotation_of(*angles), imgraft_rotation(*angles), atol=1e-15)
    assert np.linalg.det(rotation_of(*angles)) == pytest.approx(1)


def test_at_nadir_with_yaw_zero_up_is_east_and_right_is_south() -> None:
    view = View(LENSES["pinhole"], Pose.of_angles(np.array([0.0, 0, 100]), 0, math.pi / 2, 0))
    centre, up, right = view.to_plane(np.array([[959.5, 539.5], [959.5, 0], [1919, 539.5]]), 0.0)
    assert np.allclose(centre, 0, atol=1e-9)
    assert up[0] > 10
    assert abs(up[1]) < 1e-9
    assert right[1] < -10
    assert abs(right[0]) < 1e-9


def test_yaw_of_a_quarter_looks_north_and_pitch_is_downwards() -> None:
    forward = rotation_of(math.pi / 2, 0.3, 0)[2]
    assert np.allclose(forward, [0, math.cos(0.3), -math.sin(0.3)])


@pytest.mark.parametrize("angles", ANGLES)
def test_angles_and_quaternions_come_back(angles: tuple[float, float, float]) -> None:
    pose = Pose.of_angles(np.array([1.0, 2, 3]), *angles)
    assert np.allclose(rotation_of(*pose.angles_rad), pose.cam_R_map, atol=1e-12)
    assert np.allclose(pose.angles_rad, angles, atol=1e-9)
    back = Pose.of_quaternion(pose.position_m, pose.map_q_optical)
    assert np.allclose(back.cam_R_map, pose.cam_R_map, atol=1e-12)
    assert pose.map_q_optical[3] >= 0


def test_body_axes_are_forward_left_up() -> None:
    level_north = Pose.of_angles(np.zeros(3), math.pi / 2, 0, 0)
    map_R_body = level_north.cam_R_map.T @ BODY_R_OPTICAL.T
    assert np.allclose(map_R_body, [[0, -1, 0], [1, 0, 0], [0, 0, 1]])  # forward is north, left is west, up is up


def test_quaternion_turns_as_geometry_msgs_says() -> None:
    quarter_left = np.array([0, 0, math.sqrt(0.5), math.sqrt(0.5)])
    assert np.allclose(rotation_of_quaternion(quarter_left) @ [1, 0, 0], [0, 1, 0])
    assert np.allclose(quaternion_of(rotation_of_quaternion(quarter_left)), quarter_left)
    with pytest.raises(InputError, match="it must be 1"):
        rotation_of_quaternion(np.array([0, 0, 0, 0.5]))


@pytest.mark.parametrize("lens", LENSES)
def test_projection_is_that_of_opencv(lens: str) -> None:
    camera, pose = LENSES[lens], Pose.of_angles(np.array([3.0, -4, 46]), 0.4, 1.1, 0.05)
    view = View(camera, pose)
    points = np.random.default_rng(1).uniform([0, 0, -2], [40, 40, 3], (50, 3))
    in_camera = pose.to_camera(points).reshape(-1, 1, 3)
    zero = np.zeros(3)
    of_cv = cv2.fisheye.projectPoints if camera.fisheye else cv2.projectPoints
    expected = np.asarray(of_cv(in_camera, zero, zero, camera.K, camera.D)[0]).reshape(-1, 2)
    assert np.allclose(view.project(points), expected, atol=1e-6)


@pytest.mark.parametrize("lens", LENSES)
def test_pixels_come_back_from_the_plane(lens: str) -> None:
    view = View(LENSES[lens], Pose.of_angles(np.array([3.0, -4, 46]), 0.4, 0.9, 0.05))
    pixels = np.random.default_rng(3).uniform([5, 200], [1910, 1070], (200, 2))
    ground = view.to_plane(pixels, 1.5)
    again = view.project(np.column_stack([ground, np.full(len(ground), 1.5)]))
    assert np.allclose(again, pixels, atol=1e-5)


def test_homography_of_the_plane_is_the_projection() -> None:
    view = View(LENSES["pinhole"], Pose.of_angles(np.array([3.0, -4, 46]), 0.4, 0.9, 0.05))
    ground = np.random.default_rng(4).uniform(0, 30, (20, 2))
    points = np.column_stack([ground, np.full(20, -2.0)])
    assert np.allclose(apply(view.image_H_map(-2.0), ground), view.project(points), atol=1e-9)


def test_gsd_at_nadir_is_height_over_focal_length() -> None:
    camera = Camera(np.array([[1500.0, 0, 959.5], [0, 1500, 539.5], [0, 0, 1]]), np.zeros(0), "plumb_bob", SIZE)
    view = View(camera, Pose.of_angles(np.array([0.0, 0, 47.5]), 1.0, math.pi / 2, 0))
    assert view.gsd_m(np.array([[100.0, 900], [959.5, 539.5]]), 2.5) == pytest.approx(45 / 1500, abs=1e-12)


def test_nothing_is_seen_above_the_horizon() -> None:
    view = View(LENSES["plumb_bob"], Pose.of_angles(np.array([0.0, 0, 20]), 0, 0.1, 0))
    above, below = view.to_plane(np.array([[960.0, 100], [960, 900]]), 0.0)
    assert np.isnan(above).all()
    assert below[0] > 0
    outline = view.footprint_m(0.0)
    assert np.isfinite(outline).all()
    assert (outline[:, 0] > 0).all()


def test_nothing_behind_the_camera_is_projected() -> None:
    view = View(LENSES["pinhole"], Pose.of_angles(np.zeros(3), 0, 0, 0))
    assert np.isnan(view.project(np.array([[-5.0, 0, 0], [0, 0, 0]]))).all()


def test_water_above_the_camera_is_refused() -> None:
    view = View(LENSES["pinhole"], Pose.of_angles(np.array([0.0, 0, 20]), 0, 1, 0))
    with pytest.raises(InputError, match="not below the camera at 20 m"):
        view.to_plane(np.array([[960.0, 540]]), 20.0)


def test_pose_refuses_what_is_no_rotation() -> None:
    for R in (np.eye(3) * 1.1, np.diag([1.0, 1, -1]), np.full((3, 3), np.nan)):
        with pytest.raises(InputError, match="of a pose must be"):
            Pose(np.zeros(3), R)
