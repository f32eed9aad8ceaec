"""`stab-ros velocity` as users call it."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from conftest import Command
from moving_texture_lspiv import texture
from recordings import write_video
from scipy.io import netcdf_file

from stab_ros.georeferencing.local_frame import LocalFrame
from stab_ros.imaging.camera import Camera
from stab_ros.imaging.pose import Pose
from stab_ros.io.bag import open_bag
from stab_ros.io.camera_file import CameraFile, write_camera_file
from stab_ros.io.fix_message import read_fix
from stab_ros.io.point_cloud import read_cloud
from stab_ros.io.velocity_csv import read_velocities
from stab_ros.io.velocity_message import read_velocity
from stab_ros.jobs.discharge_input import read_measured
from stab_ros.synthetic.camera_path import Pose as CameraPose
from stab_ros.synthetic.flight import Shot

SHORT = ("-p", "extract_s:=0.2", "-p", "max_gap_s:=1.0", "-p", "features:=200")


@pytest.fixture(scope="module")
def measured(recordings: dict[str, Path], executable: Command, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with every output of a flight whose reference has 2 cm per pixel."""
    folder = tmp_path_factory.mktemp("velocity")
    done = executable("velocity", recordings["mcap"], folder / "V.mcap", "--csv", folder / "V.csv", "--tracks",
                      folder / "T.geojson", "--netcdf", folder / "V.nc", "--netcdf-grid",
                      folder / "G.nc", "--html", folder / "V.html", "-p",
                      "gsd_m:=0.02", "-p", "origin:=46.1, 7.2, 300", *SHORT)
    assert done.returncode == 0, done.stderr
    assert "m/s" in done.stdout
    assert re.search(r"^dropped: +(none|\d+ \w+(, \d+ \w+)*)$", done.stdout, re.MULTILINE), done.stdout
    return folder


def test_outputs_tell_the_same(measured: Path) -> None:
    table = read_velocities(measured / "V.csv")
    with open_bag(measured / "V.mcap") as bag:
        parts = [read_velocity(message.data)[1] for message in bag.messages(["/cam/velocity"])]
        assert {"/cam/velocity", "/cam/velocity_grid", "/cam/velocimetry_node/markers"} <= set(bag.topics)
    np.testing.assert_array_equal(np.concatenate([part.start_m for part in parts]), table.start_m)
    np.testing.assert_array_equal(np.concatenate([part.shared for part in parts]), table.shared)
    assert len(json.loads((measured / "T.geojson").read_text())["features"]) == len(table) > 0


def test_grid_is_that_of_the_topic(measured: Path) -> None:
    with open_bag(measured / "V.mcap") as bag:
        clouds = [read_cloud(message.data) for message in bag.messages(["/cam/velocity_grid"])]
    opened: Any = netcdf_file(measured / "G.nc", "r", mmap=False)
    with opened as file:
        read = {name: file.variables[name][:] for name in ("x", "y", "time", "vx", "var_vy", "standard_error", "count")}
        first_ns = int(file.first_stamp_ns)
    stamps_s = [(header.stamp_ns - first_ns) / 1e9 for header, _ in clouds]
    np.testing.assert_allclose(read["time"], stamps_s, atol=1e-9)
    assert len(clouds) > 1
    for number, (_, table) in enumerate(clouds):
        column, row = (np.argmin(np.abs(table[axis][:, None] - read[axis]), axis=1) for axis in "xy")
        np.testing.assert_allclose(read["x"][column], table["x"], atol=1e-9)
        for name in ("vx", "var_vy", "standard_error", "count"):
            np.testing.assert_array_equal(read[name][number, row, column], table[name])
        assert read["count"][number].sum() == table["count"].sum()
        np.testing.assert_array_equal(np.isnan(read["vx"][number]), read["count"][number] == 0)


def test_origin_of_the_map_is_told(measured: Path) -> None:
    """`discharge` takes a section in a reference system by it."""
    with open_bag(measured / "V.mcap") as bag:
        (origin,) = [read_fix(one.data) for one in bag.messages(["/cam/velocimetry_node/origin"])]
    assert (origin.latitude_deg, origin.longitude_deg, origin.height_m) == (46.1, 7.2, 300.0)
    assert read_measured(measured / "V.mcap").origin == LocalFrame(46.1, 7.2, 300.0)


def test_a_scale_that_is_given_is_that_of_no_water_level(measured: Path) -> None:
    """`discharge` doubts no level by it, and takes none from it."""
    assert read_measured(measured / "V.mcap").used_wse_m is None


def test_page_tells_of_the_bank(measured: Path) -> None:
    page = (measured / "V.html").read_text()
    assert "vectors dropped" in page
    assert "The bank moves by" in page or "No static map" in page or "too little" in page
    assert page.count("<img") >= 4


def test_pixels_without_georeference(recordings: dict[str, Path], command: Command, tmp_path: Path) -> None:
    done = command("velocity", recordings["mcap"], tmp_path / "V.mcap", "--csv", tmp_path / "V.csv", *SHORT)
    assert done.returncode == 0, done.stderr
    vectors = read_velocities(tmp_path / "V.csv")
    assert (vectors.unit, "px/s" in done.stdout) == ("px", True)


@pytest.mark.parametrize(("words", "what"), [
    (("-p", "extract_s:=0"), "extract_s"),
    (("-p", "no_such:=1"), "no_such"),
    (("--csv", "V.txt"), "*.csv"),
    (("-p", "orientation:=dynamic_gcps"), "ground control points"),
])
def test_bad_arguments_are_one_line(
    recordings: dict[str, Path], command: Command, tmp_path: Path, words: tuple[str, ...], what: str
) -> None:
    done = command("velocity", recordings["mcap"], tmp_path / "V.mcap", *words)
    assert done.returncode == 2
    assert what in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
    assert not list(tmp_path.iterdir())


def test_intervals_that_do_not_end_are_said(recordings: dict[str, Path], command: Command, tmp_path: Path) -> None:
    said = command("velocity", recordings["mcap"], tmp_path / "V.mcap", "-p", "method:=lspiv", "-p",
                   "lspiv.interval_s:=100").stderr
    assert "not one vector was measured in 0 intervals; lspiv.interval_s is longer than the recording" in said


def test_pictures_in_which_all_stands_still_are_said(command: Command, tmp_path: Path) -> None:
    still = np.clip(128 + 30 * texture(np.random.default_rng(5))[:240, :320], 0, 255).astype(np.uint8)
    ground = np.full(still.shape, 255, np.uint8)
    ground[200:], still[180:] = 0, 128
    cv2.imwrite(str(tmp_path / "ground.png"), ground)
    shots = [Shot(k, 0, still, np.eye(3), CameraPose(), np.ones(still.shape, bool)) for k in range(26)]
    done = command("velocity", write_video(tmp_path / "still.mkv", shots), tmp_path / "V.mcap", "-p",
                   f"static_map:={tmp_path / 'ground.png'}")
    assert done.returncode == 0, done.stderr
    assert "all that was seen stands still and counts as bank" in done.stderr
    assert "extract_s" not in done.stderr


def test_a_missing_water_level_is_said(recordings: dict[str, Path], command: Command, tmp_path: Path) -> None:
    """With the pose of a camera the scale depends on it; 0 m is a level like others, if it is meant."""
    camera = Camera(np.array([[400.0, 0, 240], [0, 400, 135], [0, 0, 1]]), np.zeros(0), "plumb_bob", (480, 270))
    pose = Pose.of_angles(np.array([0, 0, 60.0]), 1.57, 1.5, 0.0)
    write_camera_file(tmp_path / "camera.yaml", CameraFile(camera, pose=pose, pose_covariance=1e-4 * np.eye(6)))
    words = ("velocity", recordings["mcap"], tmp_path / "V.mcap", "--force", "--camera", tmp_path / "camera.yaml",
             "--limit", "4", *SHORT)
    missing = "no water_level is recorded, and no wse_m is given: the water surface is taken to lie at 0 m"
    said = command(*words).stderr
    assert missing in said
    assert "velocities are measured everywhere, on the bank, too" in said  # as no tracker runs
    said = command(*words, "-p", "wse_m:=0", "-p", "roi:=[[[100,50],[380,50],[380,220],[100,220]]]").stderr
    assert "water" not in said
