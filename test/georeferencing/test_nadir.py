"""Views that are taken for nadir: what control points and homographies tell against it."""

import math

import numpy as np
import pytest

from stab_ros.core.errors import InputError
from stab_ros.core.geometry import apply, grid, jacobian
from stab_ros.core.types import FloatArray, Frame
from stab_ros.georeferencing.control_points import ControlPoints
from stab_ros.georeferencing.georeferencer import Georeferenced, Georeferencer
from stab_ros.georeferencing.orientations import make_orientation
from stab_ros.georeferencing.placement import Motion
from stab_ros.georeferencing.sensors import Sensors
from stab_ros.georeferencing.settings import GeoreferenceConfig
from stab_ros.imaging.camera import Camera
from stab_ros.imaging.pose import Pose
from stab_ros.imaging.view import View

CAMERA = Camera(np.array([[1500.0, 0, 963.2], [0, 1500, 535.1], [0, 0, 1]]), np.array([-0.05, 0.01, 0, 0, 0]),
                "plumb_bob", (1920, 1080))
SIZE, SIGMA_PX = CAMERA.size, 0.05
PLACES = np.array([[115.0, 208, 0.5], [89, 205, 0], [86, 192, 0.2], [112, 191, 0], [100, 211, 1]])
FRAME = Frame(np.zeros((1080, 1920), np.uint8), "mono8", 10**9)


def _pose(pitch_deg: float, away: FloatArray | None = None) -> Pose:
    place = np.array([100.0, 200, 46]) + (np.zeros(3) if away is None else away)
    return Pose.of_angles(place, 0.4, math.radians(pitch_deg), 0.0)


def _gcps(pose: Pose, noise_px: float = 0.3) -> ControlPoints:
    noise = np.random.default_rng(1).normal(0, noise_px, (5, 2))
    return ControlPoints(tuple("ABCDE"), View(CAMERA, pose).project(PLACES) + noise, PLACES)


def _by_points(pose: Pose, noise_px: float = 0.3, **values: float) -> Georeferenced:
    config = GeoreferenceConfig(orientation="stationary_nadir", gcp_sigma_px=max(noise_px, 0.01), gcp_sigma_m=0.0,
                                height_m=values.get("height_m", 46.0))
    orientation = make_orientation(config, CAMERA, True, _gcps(pose, noise_px))
    return Georeferencer(config, CAMERA, orientation, Sensors(0.0)).frame(FRAME)


def test_points_tell_place_and_heading_of_a_nadir_view() -> None:
    answer = _by_points(_pose(90), 1e-9).placement
    assert answer is not None
    assert not answer.warnings
    pixels = np.array([[100.0, 100], [1800, 900]])
    straight = CAMERA.rays(pixels) @ CAMERA.K[:2, :2].T + CAMERA.K[:2, 2]
    truth = View(CAMERA, _pose(90)).to_plane(pixels, 0.0)
    np.testing.assert_allclose(apply(answer.map_H_image, straight), truth, atol=1e-6)


def test_a_pitch_of_two_degrees_shows_in_the_residuals() -> None:
    answer = _by_points(_pose(88)).placement
    assert answer is not None
    (doubt,) = answer.warnings
    assert "contradict a nadir view" in doubt
    assert "a tilt of 2." in doubt
    assert answer.values["rmse_px"] > 3
    straight_down = _by_points(_pose(90)).placement
    assert straight_down is not None
    assert not straight_down.warnings


def test_a_height_in_feet_is_said() -> None:
    answer = _by_points(_pose(90), height_m=46 * 3.28084).placement
    assert answer is not None
    assert "one of them is in feet, it must be in metres" in answer.warnings[0]


def test_water_or_points_above_the_camera_are_refused() -> None:
    with pytest.raises(InputError, match=r"control point 'E' at 1 m is not below the camera at 0\.8 m"):
        _by_points(_pose(90), height_m=0.8)


@pytest.mark.parametrize("swapped_m", [None, PLACES])
def test_swapped_points_are_said(swapped_m: FloatArray | None) -> None:
    config = GeoreferenceConfig(orientation="stationary_nadir", height_m=46.0)
    seen = _gcps(_pose(90))
    gcps = ControlPoints(seen.names, seen.image_px, PLACES[:, [1, 0, 2]], swapped_m)
    with pytest.raises(InputError, match=r"none of a nadir view: east and north .* swapped: read so, the points fit"):
        make_orientation(config, CAMERA, True, gcps)


def test_points_that_put_the_camera_below_them_are_said() -> None:
    config = GeoreferenceConfig(orientation="stationary_nadir", height_m=46.0)
    upward = View(CAMERA, Pose.of_angles(np.array([100.0, 200, -46]), 0.4, -math.pi / 2, 0.0))
    gcps = ControlPoints(tuple("ABCDE"), upward.project(PLACES), PLACES)
    orientation = make_orientation(config, CAMERA, True, gcps)
    answer = Georeferencer(config, CAMERA, orientation, Sensors(0.0)).frame(FRAME).placement
    assert answer is not None
    assert "the points put the camera at -46.00 m, below all of them (the lowest at 0.00 m)" in answer.warnings[0]


def _flight(orientation: str, pitch_deg: float, sway_m: float, frames: int = 30) -> Georeferenced:
    """The last answer of a drone in gusts, its homographies with a noise of 0.05 px."""
    config = GeoreferenceConfig(orientation=orientation, height_m=46.0)
    engine = Georeferencer(config, CAMERA, make_orientation(config, CAMERA, True), Sensors(0.0))
    rng, first = np.random.default_rng(3), View(CAMERA, _pose(pitch_deg)).image_H_map(0.0)
    for number in range(frames):
        away = sway_m * np.array([math.sin(number / 4), math.cos(number / 3), 0.5 * math.sin(number / 5)])
        pose = _pose(pitch_deg + 0.5 * math.sin(number / 3), away)
        H = first @ np.linalg.inv(View(CAMERA, pose).image_H_map(0.0))
        H /= H[2, 2]
        J = jacobian(H, grid(SIZE))
        C = np.linalg.inv(np.einsum("nij,nik->jk", J, J)) * SIGMA_PX**2
        H += np.append(rng.multivariate_normal(np.zeros(8), C), 0).reshape(3, 3)
        answer = engine.frame(FRAME, Motion(H, C))
    return answer


def test_homographies_of_a_hovering_drone_tell_the_tilt() -> None:
    answer = _flight("dynamic_stabilization", 88, 0.4).placement
    assert answer is not None
    assert any("tilted by 2." in doubt and "+- 0." in doubt for doubt in answer.warnings), answer.warnings


@pytest.mark.parametrize(("pitch_deg", "sway_m"), [(90, 0.4), (88, 0.0)])
def test_nadir_and_unmoved_cameras_are_not_doubted(pitch_deg: float, sway_m: float) -> None:
    answer = _flight("dynamic_stabilization", pitch_deg, sway_m).placement
    assert answer is not None
    assert not answer.warnings


def test_a_camera_that_is_taken_for_a_still_one_and_moves_is_told_of() -> None:
    answer = _flight("stationary_nadir", 90, 0.4).placement
    assert answer is not None
    assert any("the camera is not still" in doubt for doubt in answer.warnings)
    assert answer.values["moved_px"] > 2
