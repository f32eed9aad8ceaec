"""The engine of georeferencing as parameters and files make it: which of them counts."""

from __future__ import annotations

import math
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest

from stab_ros.core.errors import InputError
from stab_ros.core.settings import Value
from stab_ros.core.types import FloatArray, Frame
from stab_ros.georeferencing.local_frame import LocalFrame
from stab_ros.imaging.camera import Camera
from stab_ros.imaging.pose import Pose
from stab_ros.imaging.view import View
from stab_ros.io.camera_file import CameraFile, write_camera_file
from stab_ros.parameters.engines import check_georeference, crs_of, make_georeferencer

PLACES_M = np.array([[-60.0, 40, 305], [60, 50, 306], [70, 160, 305], [-80, 150, 307], [5, 90, 305], [20, 60, 309]])
HERE = LocalFrame(45.1, 8.2, 0.0)
CAMERA = Camera(np.array([[500.0, 0, 319.5], [0, 500, 179.5], [0, 0, 1]]), np.zeros(5), "plumb_bob", (640, 360))
POSE = Pose.of_angles(np.array([2.0, -30, 325]), 1.4, math.radians(50), 0.02)


def write_gcps(path: Path, header: str, places: FloatArray) -> None:
    """The points at PLACES_M as the camera sees them, with other coordinates."""
    view = View(CAMERA, Pose.of_angles(np.array([2.0, -30, 425]), math.pi / 2, math.radians(50), 0.02))
    rows = [f"G{k},{','.join(map(repr, map(float, (*pixel, *place))))}" for k, (pixel, place) in enumerate(
        zip(view.project(PLACES_M), places, strict=True))]
    path.write_text("\n".join([f"name,x,y,{header}", *rows]))


@pytest.mark.parametrize(("given", "used_m"), [({}, 305.0), ({"wse_m": 0.0}, 0.0), ({"wse_m": 301.5}, 301.5)])
def test_a_level_that_is_given_counts_for_more_than_that_of_the_file(
        given: dict[str, Value], used_m: float, tmp_path: Path) -> None:
    write_camera_file(tmp_path / "camera.yaml", CameraFile(CAMERA, pose=POSE, wse_m=305.0))
    values = {"orientation": "stationary_gcps", "camera_file": str(tmp_path / "camera.yaml"), **given}
    assert make_georeferencer(values, None, CAMERA.size).wse_m == used_m


@pytest.mark.parametrize("origin", ["45.4, 8.9, 0", "45.1, 8.2, 250", "44.5, 7.4, -30"])
def test_an_origin_moves_the_pose_of_the_file(origin: str, tmp_path: Path) -> None:
    """The camera, what it looks at and the level under it stay where they are on the Earth."""
    covariance = np.diag([1e-4, 4e-4, 9e-4, 1e-8, 4e-8, 9e-8])
    write_camera_file(tmp_path / "camera.yaml", CameraFile(
        CAMERA, pose=POSE, pose_covariance=covariance, crs="EPSG:32632", frame=HERE, wse_m=305.0))
    values: dict[str, Value] = {"orientation": "stationary_gcps", "camera_file": str(tmp_path / "camera.yaml"),
                                "wse_sigma_m": 0.0}
    places, sigmas_m = [], []
    for more in ({}, {"origin": origin}):
        engine = make_georeferencer({**values, **more}, None, CAMERA.size)
        answer = engine.frame(Frame(np.zeros((360, 640), np.uint8), "mono8", 1)).placement
        assert answer is not None
        assert answer.pose is not None
        assert engine.local_frame is not None
        camera_m = answer.pose.position_m
        looked_at_m = camera_m + answer.pose.cam_R_map.T @ [30.0, -20, 100]
        level_m = np.append(camera_m[:2], engine.wse_m)
        places.append(engine.local_frame.to_geodetic(np.stack([camera_m, looked_at_m, level_m])))
        sigmas_m.append(answer.values["sigma_m"])
    off_m = np.abs(places[1] - places[0]) * [111_000, 80_000, 1]
    assert off_m[:2].max() < 1e-5
    assert off_m[2, 2] < 0.01  # what is below the camera lies askew, by the angle between the two verticals
    assert sigmas_m[1] == pytest.approx(sigmas_m[0], rel=0.1)


def test_an_origin_far_from_the_pose_is_refused(tmp_path: Path) -> None:
    write_camera_file(tmp_path / "camera.yaml", CameraFile(CAMERA, pose=POSE, crs="EPSG:32632",
                                                           frame=LocalFrame(44.7, 8.4, 0.0)))
    values = {"orientation": "stationary_gcps", "camera_file": str(tmp_path / "camera.yaml"), "origin": "46, 9, 0"}
    with pytest.raises(InputError, match=r"origin and camera file contradict each other, .* are 15\d km from"):
        make_georeferencer(values, None, CAMERA.size)
    with pytest.raises(InputError, match="origin and camera file contradict"):
        check_georeference(values)


def test_local_control_points_and_fixes_need_one_map(tmp_path: Path) -> None:
    write_gcps(tmp_path / "gcps.csv", "X,Y,Z", PLACES_M)
    values: dict[str, Value] = {"orientation": "dynamic_gps_imu", "gcps_file": str(tmp_path / "gcps.csv"),
                                "wse_m": 305.0}
    with pytest.raises(InputError, match="local control points and fixes of GPS need one map, give crs"):
        make_georeferencer(values, CAMERA, CAMERA.size)
    with pytest.raises(InputError, match="local control points and fixes of GPS need one map, give crs"):
        check_georeference(values)
    one_map: tuple[dict[str, Value], ...] = (
        {"origin": "45, 8, 0"}, {"crs": "EPSG:32632"}, {"orientation": "stationary_gcps"})
    for more in one_map:
        check_georeference({**values, **more})
    for frame, refused in ((HERE, False), (None, True)):
        write_camera_file(tmp_path / "camera.yaml", CameraFile(CAMERA, frame=frame))
        with pytest.raises(InputError, match="need one map") if refused else nullcontext():
            check_georeference({**values, "camera_file": str(tmp_path / "camera.yaml")})
    engine = make_georeferencer({**values, "origin": "45, 8, 0"}, CAMERA, CAMERA.size)
    assert engine.local_frame == LocalFrame(45, 8, 0)


def test_a_projected_system_beside_latitudes_and_longitudes_is_that_of_orthophotos(tmp_path: Path) -> None:
    write_gcps(tmp_path / "gcps.csv", "lat,lon,height", HERE.to_geodetic(PLACES_M))
    values: dict[str, Value] = {"orientation": "stationary_gcps", "gcps_file": str(tmp_path / "gcps.csv"),
                                "wse_m": 300.0}
    check_georeference({**values, "orientation": "dynamic_gps_imu"})
    plain, with_crs = (make_georeferencer({**values, **more}, CAMERA, CAMERA.size) for more in (
        {}, {"crs": "EPSG:32632"}))
    assert plain.gcps is not None
    assert with_crs.gcps is not None
    assert (plain.gcps.map_m == with_crs.gcps.map_m).all()
    assert (crs_of(values), crs_of({**values, "crs": "EPSG:32632"})) == ("local", "EPSG:32632")


def test_files_tell_the_reference_system_of_orthophotos(tmp_path: Path) -> None:
    camera_file = str(tmp_path / "camera.yaml")
    write_camera_file(tmp_path / "camera.yaml", CameraFile(CAMERA, pose=POSE, crs="EPSG:32632", frame=HERE))
    assert crs_of({"camera_file": camera_file}) == "EPSG:32632"
    assert crs_of({"camera_file": camera_file, "crs": "local"}) == "local"
    write_gcps(tmp_path / "gcps.csv", "X,Y,Z", PLACES_M)
    assert crs_of({"gcps_file": str(tmp_path / "gcps.csv")}) == "local"
    write_camera_file(tmp_path / "camera.yaml", CameraFile(CAMERA, pose=POSE, crs="EPSG:4326", frame=HERE))
    assert crs_of({"camera_file": camera_file}) == "local"  # degrees are none of an orthophoto
    write_camera_file(tmp_path / "camera.yaml", CameraFile(CAMERA, pose=POSE, crs="EPSG:32632"))
    assert crs_of({"camera_file": camera_file}) == "local"  # where its map lies is not known
