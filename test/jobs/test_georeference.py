"""`stab-ros georeference` on the recorded flight, whose true homographies are known."""

import csv
import math
from pathlib import Path

import cv2
import numpy as np
import pytest
import rasterio
from bag_makers import with_compressed

from stab_ros.cli import main
from stab_ros.core.geometry import apply, grid, normalized
from stab_ros.core.types import FloatArray
from stab_ros.georeferencing.known_scale import nadir_H
from stab_ros.georeferencing.local_frame import LocalFrame
from stab_ros.imaging.pose import Pose
from stab_ros.io.bag import open_bag
from stab_ros.io.camera_file import CameraFile, write_camera_file
from stab_ros.io.diagnostics_message import read_values
from stab_ros.io.homographies import read_homographies
from stab_ros.io.homography_message import read_homography
from stab_ros.io.image_message import read_image
from stab_ros.parameters.engines import uncalibrated

SAMPLE, TRUTH = Path("bags/sample.mcap"), Path("bags/sample_truth.csv")
FRAMES, SIZE, GSD_M = 30, (960, 540), 0.03
SCALE = ["-p", "orientation:=dynamic_stabilization", "-p", f"gsd_m:={GSD_M}"]


@pytest.fixture(scope="module")
def georeferenced(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("georeferenced")
    assert main(["georeference", str(SAMPLE), str(folder / "o.mcap"), *SCALE, "--limit", str(FRAMES),
                 "--homographies", str(folder / "h.csv"), "--geotiff", str(folder / "tiffs"), "--interval", "1"]) == 0
    return folder


def _infos(path: Path) -> dict[int, FloatArray]:
    with open_bag(path) as bag:
        found = [read_homography(message.data) for message in bag.messages(["/camera/ortho_info"])]
    return {stamp_ns: H for stamp_ns, H in found if H is not None}


def test_every_frame_lies_where_the_truth_says(georeferenced: Path) -> None:
    map_H_ref = nadir_H(uncalibrated(SIZE), GSD_M, np.pi / 2)
    truth = {row.frame: row.ref_H_cur for row in read_homographies(TRUTH)}
    rows = read_homographies(georeferenced / "h.csv")
    assert len(rows) == FRAMES
    for row in rows:
        true_H = truth[row.frame]
        assert row.ref_H_cur is not None
        assert true_H is not None
        off_m = apply(row.ref_H_cur, grid(SIZE)) - apply(map_H_ref @ true_H, grid(SIZE))
        assert np.linalg.norm(off_m, axis=1).max() < 0.02


def test_image_info_and_status_are_of_one_grid(georeferenced: Path) -> None:
    infos = _infos(georeferenced / "o.mcap")
    rows = {row.stamp_ns: row.ref_H_cur for row in read_homographies(georeferenced / "h.csv")}
    with open_bag(georeferenced / "o.mcap") as bag:
        status = [read_values(message.data) for message in bag.messages(["/camera/georeference_node/status"])]
        images = [read_image(message.data, "sensor_msgs/msg/Image") for message in bag.messages(
            ["/camera/image_ortho"])]
    assert len(infos) == len(status) == len(images) == FRAMES
    assert {image.size for image in images} == {(960, 540)}
    for (stamp_ns, ortho_H_image), values in zip(infos.items(), status, strict=True):
        r, west, north = (float(values[key]) for key in ("resolution_m", "west_m", "north_m"))
        ortho_H_map = np.array([[1 / r, 0, -west / r - 0.5], [0, -1 / r, north / r - 0.5], [0, 0, 1]])
        np.testing.assert_allclose(normalized(ortho_H_map @ rows[stamp_ns]), ortho_H_image, rtol=1e-9, atol=1e-9)
        assert values["state"] == "PLACED"


def test_geotiffs_show_the_orthophotos_of_first_and_last_frames(georeferenced: Path) -> None:
    with open_bag(georeferenced / "o.mcap") as bag:
        images = {frame.stamp_ns: frame.image for frame in (read_image(message.data, "sensor_msgs/msg/Image")
                                                            for message in bag.messages(["/camera/image_ortho"]))}
    stamps = sorted(images)
    seconds = [stamp_ns for stamp_ns in stamps if stamp_ns < stamps[0] + 10**9]
    tiffs = sorted((georeferenced / "tiffs").glob("*.tif"))
    assert [int(path.stem.removeprefix("ortho_")) for path in tiffs[:2]] == [seconds[0], seconds[-1]]
    for path in tiffs:
        with rasterio.open(path) as found:
            image = np.atleast_3d(images[int(path.stem.removeprefix("ortho_"))])
            assert (np.moveaxis(found.read(), 0, -1) == image[..., ::-1]).all()
            assert found.res == pytest.approx((float(found.res[0]), float(found.res[0])))


@pytest.mark.parametrize("compressed", [False, True])
def test_a_stabilised_recording_gives_the_same_places(compressed: bool, georeferenced: Path, tmp_path: Path) -> None:
    stabilised, output = tmp_path / "s.mcap", tmp_path / "o.mcap"
    assert main(["stabilize", str(SAMPLE), str(stabilised), "--limit", str(FRAMES)]) == 0
    if compressed:
        stabilised = with_compressed(stabilised, tmp_path / "small.mcap", ("/camera/image_stabilized",))
    assert main(["georeference", str(stabilised), str(output), *SCALE, "--homographies", str(tmp_path / "h.csv")]) == 0
    for ours, theirs in zip(read_homographies(georeferenced / "h.csv"), read_homographies(tmp_path / "h.csv"),
                            strict=True):
        assert ours.ref_H_cur is not None
        assert theirs.ref_H_cur is not None
        assert np.abs(apply(ours.ref_H_cur, grid(SIZE)) - apply(theirs.ref_H_cur, grid(SIZE))).max() < 1e-9
    first, *others = _infos(output).values()
    for other in others:  # the image is in the place of the reference already
        assert np.abs(apply(first, grid(SIZE)) - apply(other, grid(SIZE))).max() < 1e-6


@pytest.mark.parametrize(("arguments", "said"), [
    (["-p", "orientation:=dynamic_stabilization"], "needs a scale"),
    (["-p", "orientation:=dynamic_gcps"], "needs ground control points"),
    ([*SCALE, "-p", "extent:=1,2,3"], "extent: '1,2,3' must be 4 numbers between commas"),
    ([*SCALE, "-p", "extent:=5,0,1,2"], "west < east"),
    (["-p", "orientation:=stationary_nadri"], "did you mean stationary_nadir"),
    ([*SCALE, "-p", "heigth_m:=3"], "did you mean height_m"),
])
def test_bad_input_is_one_line(arguments: list[str], said: str, tmp_path: Path,
                               capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["georeference", str(SAMPLE), str(tmp_path / "o.mcap"), *arguments]) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert said in line
    assert not list(tmp_path.iterdir())


def test_a_picture_without_calibration_is_refused_where_it_is_needed(
        tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "pictures"
    folder.mkdir()
    assert cv2.imwrite(str(folder / "1.png"), np.full((80, 120), 7, np.uint8))
    assert main(["georeference", str(folder), str(tmp_path / "o.mcap"), "-p", "orientation:=stationary_nadir", "-p",
                 "height_m:=20"]) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert "stationary_nadir needs the calibration of the camera" in line
    assert [path.name for path in tmp_path.iterdir()] == ["pictures"]


@pytest.mark.parametrize(("crs", "code"), [("EPSG:32632", 32632), ("EPSG:4326", None)])
def test_geotiffs_have_the_projected_system_of_the_camera_file(crs: str, code: int | None, tmp_path: Path,
                                                               capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "pictures").mkdir()
    assert cv2.imwrite(str(tmp_path / "pictures" / "1.png"), np.full((80, 120), 7, np.uint8))
    pose = Pose.of_angles(np.array([2.0, -30, 325]), 1.4, math.radians(50), 0.02)
    write_camera_file(tmp_path / "camera.yaml", CameraFile(
        uncalibrated((120, 80)), pose=pose, crs=crs, frame=LocalFrame(45.1, 8.2, 0.0), wse_m=305.0))
    assert main(["georeference", str(tmp_path / "pictures"), str(tmp_path / "o.mcap"), "--camera",
                 str(tmp_path / "camera.yaml"), "--geotiff", str(tmp_path / "tiffs")]) == 0
    (path,) = (tmp_path / "tiffs").glob("*.tif")
    with rasterio.open(path) as found:
        assert (found.crs.is_projected, found.crs.to_epsg()) == (code is not None, code)
    said = "the GeoTIFFs are in metres of the map, without a reference system; crs names one, here that of UTM is EPSG:"
    assert (said + "32632" in capsys.readouterr().err) is (code is None)


def test_the_table_is_a_csv_of_homographies(georeferenced: Path) -> None:
    with (georeferenced / "h.csv").open() as file:
        assert next(csv.reader(file))[:4] == ["frame", "stamp_ns", "status", "h00"]
