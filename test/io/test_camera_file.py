"""Camera files, and what other tools write."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml

from stab_ros.core.errors import InputError
from stab_ros.georeferencing.local_frame import LocalFrame
from stab_ros.imaging.camera import Camera
from stab_ros.imaging.pose import Pose
from stab_ros.imaging.view import View
from stab_ros.io.camera_file import CameraFile, read_camera_file, write_camera_file
from stab_ros.io.camera_profiles import camera_for, profiles

K = np.array([[1500.123456789, 0, 959.5], [0, 1501.5, 539.5], [0, 0, 1]])
CAMERA = Camera(K, np.array([-0.1, 0.02, 1e-4, -2e-5, 0]), "plumb_bob", (1920, 1080))
OF_CAMERA_CALIBRATION = """\
image_width: 640
image_height: 480
camera_name: narrow_stereo
camera_matrix:
  rows: 3
  cols: 3
  data: [438.783367, 0.000000, 305.593336, 0.000000, 437.302876, 243.738352, 0.000000, 0.000000, 1.000000]
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data: [-0.361976, 0.110510, 0.001014, 0.000505, 0.000000]
rectification_matrix:
  rows: 3
  cols: 3
  data: [0.999978, 0.002789, -0.006046, -0.002816, 0.999986, -0.004401, 0.006034, 0.004417, 0.999972]
projection_matrix:
  rows: 3
  cols: 4
  data: [393.653800, 0.000000, 322.797939, 0.000000, 0.000000, 393.653800, 241.090902, 0.000000, 0.0, 0.0, 1.0, 0.0]
"""


def test_a_camera_comes_back_to_the_last_digit(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    file = CameraFile(CAMERA, "north bank", 0.0, Pose.of_angles(np.array([1 / 3, -2e-7, 46.0]), 1, 1.2, 0.1),
                      rng.normal(size=(6, 6)), ("f_px", "k1"), rng.normal(size=(2, 2)), "EPSG:2056",
                      LocalFrame(46.1, 7.3, 0.0), 455.25)
    write_camera_file(tmp_path / "c.yaml", file)
    back = read_camera_file(tmp_path / "c.yaml")
    assert np.array_equal(back.camera.K, K)
    assert np.array_equal(back.camera.D, CAMERA.D)
    assert back.pose is not None
    assert file.pose is not None
    assert np.array_equal(back.pose.position_m, file.pose.position_m)
    assert np.allclose(back.pose.cam_R_map, file.pose.cam_R_map, atol=1e-14)
    for name in ("pose_covariance", "covariance"):
        assert np.array_equal(getattr(back, name), getattr(file, name))
    for name in ("name", "parameters", "crs", "frame", "wse_m"):
        assert getattr(back, name) == getattr(file, name)


def test_a_file_of_camera_calibration_is_read_and_ours_has_its_form(tmp_path: Path) -> None:
    path = tmp_path / "info.yaml"
    path.write_text(OF_CAMERA_CALIBRATION, encoding="utf-8")
    read = read_camera_file(path)
    assert read.camera.size == (640, 480)
    assert read.camera.D[0] == -0.361976
    assert read.pose is None
    write_camera_file(tmp_path / "ours.yaml", read)
    theirs, ours = (yaml.safe_load((tmp_path / name).read_text(encoding="utf-8"))
                    for name in ("info.yaml", "ours.yaml"))
    assert set(theirs) <= set(ours)
    assert all(theirs[key] == ours[key] for key in theirs if key not in ("rectification_matrix", "projection_matrix"))


@pytest.mark.parametrize(("change", "says"), [
    ({"camera_matrix": None}, "camera_matrix must hold 3x3 numbers"),
    ({"camera_matrix": {"data": [1, 2]}}, "camera_matrix must hold 3x3 numbers"),
    ({"camera_matrix": {"data": [0.0] * 9}}, "not calibrated"),
    ({"image_width": "wide"}, "image_width is wide"),
    ({"image_width": -1}, "image_width is -1"),
    ({"distortion_model": "thin_prism"}, "do not fit distortion_model"),
    ({"pose": {"position_m": [0, 0, 0], "map_q_optical_xyzw": [0, 0, 0, 2]}}, "it must be 1"),
    ({"pose": 3}, "pose must hold"),
    ({"origin": {"latitude_deg": 7}}, "longitude_deg is None"),
    ({"wse_m": "high"}, "wse_m is high"),
])
def test_what_contradicts_itself_is_said_in_one_line(change: dict[str, object], says: str, tmp_path: Path) -> None:
    path = tmp_path / "c.yaml"
    path.write_text(yaml.safe_dump({**yaml.safe_load(OF_CAMERA_CALIBRATION), **change}), encoding="utf-8")
    with pytest.raises(InputError, match=says) as error:
        read_camera_file(path)
    assert str(error.value).startswith(str(path))
    assert len(str(error.value).splitlines()) == 1


def test_a_calibration_is_scaled_to_pictures_of_its_shape_and_no_other(tmp_path: Path) -> None:
    write_camera_file(tmp_path / "c.yaml", CameraFile(CAMERA))
    half, remarks = camera_for(str(tmp_path / "c.yaml"), (960, 540))
    pose = Pose.of_angles(np.array([0.0, 0, 40]), 1, 1.2, 0.1)
    point = np.array([[3.0, 4, 1]])
    full_px, half_px = (View(camera, pose).project(point) for camera in (CAMERA, half.camera))
    assert np.allclose((full_px + 0.5) / 2 - 0.5, half_px)
    assert any("scaled" in remark for remark in remarks)
    with pytest.raises(InputError, match="another shape"):
        camera_for(str(tmp_path / "c.yaml"), (1920, 1440))


@pytest.mark.parametrize(("name", "diagonal_deg"), [
    ("dji_phantom_4_pro", 84), ("dji_mavic_2_pro", 77), ("dji_phantom_3_pro", 94)])
def test_profiles_have_the_field_of_view_of_their_data_sheets(name: str, diagonal_deg: float) -> None:
    assert name in profiles()
    file = read_camera_file(profiles()[name])
    half = np.hypot(*file.camera.size) / 2
    assert np.degrees(2 * np.arctan(half / file.camera.K[0, 0])) == pytest.approx(diagonal_deg, abs=2)
    video, remarks = camera_for(name, (3840, 2160))
    assert video.camera.K[1, 2] == 1079.5
    assert video.camera.K[0, 0] / 3840 == pytest.approx(file.camera.K[0, 0] / file.camera.size[0])
    assert any("data sheet" in remark for remark in remarks)


def test_an_unknown_profile_is_said_with_the_known_ones() -> None:
    with pytest.raises(InputError, match="did you mean dji_mavic_2_pro"):
        camera_for("dji_mavic_2", (1920, 1080))
