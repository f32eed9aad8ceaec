"""`stab-ros georeference` on a rendered flight, with each orientation; held-out points lie where they are."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import rasterio
from survey_bag import CAMERA, FIRST_NS, HEIGHT_M, ORIGIN, view, write_gcps, write_survey

from stab_ros.cli import main
from stab_ros.core.geometry import apply
from stab_ros.core.types import FloatArray
from stab_ros.io.bag import BagWriter, open_bag
from stab_ros.io.diagnostics_message import read_values
from stab_ros.io.fix_message import fix_cdr, read_fix
from stab_ros.io.homographies import read_homographies

WITHIN_M = 0.02
HELD_OUT = np.stack(np.meshgrid(np.linspace(-13, 13, 4), np.linspace(-7, 7, 4)), axis=-1).reshape(-1, 2)
SENSORS = ["-p", "orientation:=dynamic_gps_imu", "-p", "lever_arm_m:=-0.1,0.02,0.3"]


@pytest.fixture(scope="module", params=[60, 90])
def pitch_deg(request: pytest.FixtureRequest) -> int:
    return int(request.param)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory, pitch_deg: int) -> Path:
    path = tmp_path_factory.mktemp(f"survey{pitch_deg}")
    write_survey(path / "flight.mcap", pitch_deg)
    write_gcps(path / "gcps.csv", pitch_deg)
    return path


def _run(folder: Path, tmp_path: Path, *arguments: str) -> list[tuple[int, FloatArray]]:
    """Frame and its homography to the map."""
    origin = f"origin:={ORIGIN.latitude_deg}, {ORIGIN.longitude_deg}, {ORIGIN.height_m}"
    assert main(["georeference", str(folder / "flight.mcap"), str(tmp_path / "o.mcap"), "-p", origin, "--homographies",
                 str(tmp_path / "h.csv"), *arguments]) == 0
    return [(row.frame, row.ref_H_cur) for row in read_homographies(tmp_path / "h.csv") if row.ref_H_cur is not None]


def _error_m(found: list[tuple[int, FloatArray]], pitch_deg: int) -> float:
    worst = []
    for frame, map_H_image in found:
        pixels = view(frame, pitch_deg).project(np.column_stack([HELD_OUT, np.zeros(len(HELD_OUT))]))
        straight = CAMERA.rays(pixels) @ CAMERA.K[:2, :2].T + CAMERA.K[:2, 2]
        worst.append(np.linalg.norm(apply(map_H_image, straight) - HELD_OUT, axis=1).max())
    return float(max(worst))


@pytest.mark.parametrize("orientation", ["dynamic_gcps", "dynamic_gcps_stabilization"])
def test_control_points_place_a_moving_camera(folder: Path, tmp_path: Path, pitch_deg: int, orientation: str) -> None:
    found = _run(folder, tmp_path, "-p", f"orientation:={orientation}", "-p", "crs:=EPSG:32630", "--gcps",
                 str(folder / "gcps.csv"), "--no-image")
    assert len(found) == 6
    assert _error_m(found, pitch_deg) < WITHIN_M


def test_sensors_place_a_camera_without_control_points(folder: Path, tmp_path: Path, pitch_deg: int) -> None:
    found = _run(folder, tmp_path, *SENSORS, "--geotiff", str(tmp_path / "tiffs"), "-p", "crs:=32630")
    assert len(found) == 6
    assert _error_m(found, pitch_deg) < WITHIN_M
    with open_bag(tmp_path / "o.mcap") as bag:
        topics = {name: topic.count for name, topic in bag.topics.items()}
        (origin,) = [read_fix(message.data) for message in bag.messages(["/cam/georeference_node/origin"])]
        status = [read_values(message.data) for message in bag.messages(["/cam/georeference_node/status"])]
    assert (origin.latitude_deg, origin.longitude_deg) == (ORIGIN.latitude_deg, ORIGIN.longitude_deg)
    assert topics["/cam/image_ortho"] == topics["/cam/ortho_info"] == topics["/cam/georeference_node/pose"] == 6
    assert topics["/cam/fix"] > 100  # taken over
    assert all(0.01 < float(values["sigma_m"]) < 0.3 for values in status)
    assert all(float(values["position_age_s"]) < 0.01 for values in status)
    corner = tuple(float(status[0][key]) for key in ("west_m", "north_m", "resolution_m"))
    _check_geotiffs(tmp_path / "tiffs", found, corner)


def _check_geotiffs(folder: Path, found: list[tuple[int, FloatArray]], corner: tuple[float, ...]) -> None:
    """First and last frame, in UTM: places within a millimetre of pyproj's."""
    tiffs = sorted(folder.glob("*.tif"))
    assert [path.stem for path in tiffs] == [f"ortho_{FIRST_NS + frame * 100_000_000}" for frame, _ in
                                             (found[0], found[-1])]
    with rasterio.open(tiffs[0]) as tiff:
        assert tiff.crs.to_epsg() == 32630
        T = np.array(tiff.transform).reshape(3, 3)
    west_m, north_m, resolution_m = corner
    for east, north in HELD_OUT:
        wanted = ORIGIN.to_crs("EPSG:32630", np.array([[east, north, 0]]))[0, :2]
        there = T @ [(east - west_m) / resolution_m, (north_m - north) / resolution_m, 1]
        assert np.hypot(*(there[:2] - wanted)) < 1e-3


def test_stationary_orientations_place_the_first_frame(folder: Path, tmp_path: Path, pitch_deg: int) -> None:
    gcps = ["--gcps", str(folder / "gcps.csv"), "-p", "crs:=EPSG:32630", "--limit", "1", "--no-image", "--force"]
    assert _error_m(_run(folder, tmp_path, "-p", "orientation:=stationary_gcps", *gcps), pitch_deg) < WITHIN_M
    if pitch_deg == 90:
        nadir = ["-p", "orientation:=stationary_nadir", "-p", f"height_m:={HEIGHT_M}"]
        assert _error_m(_run(folder, tmp_path, *nadir, *gcps), pitch_deg) < WITHIN_M


def test_a_known_scale_places_a_nadir_camera_only(folder: Path, tmp_path: Path, pitch_deg: int,
                                                  capsys: pytest.CaptureFixture[str]) -> None:
    found = _run(folder, tmp_path, "-p", "orientation:=dynamic_stabilization", "-p", f"height_m:={HEIGHT_M}",
                 "--no-image")
    assert (_error_m(found, pitch_deg) < WITHIN_M) is (pitch_deg == 90)
    assert not capsys.readouterr().err  # six frames are too few to tell a tilt


def _refused(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    assert main(["georeference", str(folder / "flight.mcap"), str(tmp_path / "o.mcap"), *arguments]) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert not (tmp_path / "o.mcap.partial").exists()
    return line


def test_sensors_of_another_time_are_said(folder: Path, tmp_path: Path, pitch_deg: int,
                                          capsys: pytest.CaptureFixture[str]) -> None:
    line = _refused(folder, tmp_path, capsys, *SENSORS, "-p", "time_offset_s:=600")
    assert "not one frame can be placed: the nearest position is" in line
    assert "time_offset_s brings clocks together" in line


def test_water_above_the_camera_is_no_matter_of_clocks(folder: Path, tmp_path: Path, pitch_deg: int,
                                                       capsys: pytest.CaptureFixture[str]) -> None:
    origin = f"origin:={ORIGIN.latitude_deg}, {ORIGIN.longitude_deg}, {ORIGIN.height_m}"
    line = _refused(folder, tmp_path, capsys, *SENSORS, "-p", origin, "-p", "wse_m:=100")
    assert "not one frame can be placed: the water surface at 100 m is not below the camera at" in line
    assert line.endswith("one height datum")


def test_sensors_of_a_short_flight_are_checked_at_its_end(folder: Path, tmp_path: Path, pitch_deg: int,
                                                         capsys: pytest.CaptureFixture[str]) -> None:
    """Half a second, with one position 110 m beside the others."""
    with open_bag(folder / "flight.mcap") as bag, BagWriter(tmp_path / "jumps.mcap") as writer:
        for topic in ("/cam/fix", "/cam/imu"):
            writer.add_topic(bag.topics[topic])
            for number, message in enumerate(bag.messages([topic])):
                fix = read_fix(message.data) if topic == "/cam/fix" and number == 30 else None
                data = message.data if fix is None else fix_cdr(
                    replace(fix, latitude_deg=fix.latitude_deg + 1e-3))
                writer.write(topic, message.log_time_ns, message.log_time_ns, data)
    _run(folder, tmp_path, *SENSORS, "--no-image", "--telemetry", str(tmp_path / "jumps.mcap"))
    warnings = capsys.readouterr().err.splitlines()
    assert sum("the fix jumps 2 times, the worst by 111.3 m in 0.01 s" in line for line in warnings) == 1, warnings


def test_bad_control_points_are_one_line(folder: Path, tmp_path: Path, pitch_deg: int,
                                         capsys: pytest.CaptureFixture[str]) -> None:
    gcps = ["-p", "orientation:=stationary_gcps", "-p", "crs:=EPSG:32630", "--gcps"]
    assert "water surface at 100 m is not below the camera" in _refused(
        folder, tmp_path, capsys, *gcps, str(folder / "gcps.csv"), "-p", "wse_m:=100")
    (tmp_path / "three.csv").write_text("name,x,y,X,Y,Z\nA,2000,20,1,2,0\nB,1,1,2,3,0\nC,5,5,4,1,0\nD,9,9,5,5,0\n")
    assert "control point 'A' at (2000, 20) lies outside the 960x540 picture" in _refused(
        folder, tmp_path, capsys, "-p", "orientation:=stationary_gcps", "--gcps", str(tmp_path / "three.csv"))
    assert "no such file" in _refused(folder, tmp_path, capsys, *gcps, "none.csv").lower()

