"""`stab-ros camera`: good and bad input, and its output read back."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from control_scene import SIZE, Scene, moved
from pyproj import Transformer

from stab_ros.cli import main
from stab_ros.core.errors import InputError
from stab_ros.core.types import FloatArray
from stab_ros.georeferencing.control_points import ControlPoints
from stab_ros.georeferencing.gcp_places import placed
from stab_ros.georeferencing.local_frame import LocalFrame
from stab_ros.imaging.pose import Pose
from stab_ros.imaging.view import View
from stab_ros.io.camera_file import CameraFile, read_camera_file, write_camera_file

SCENE = Scene(relief_m=6)
POINTS = SCENE.points(9, 0.2, np.random.default_rng(1))


@pytest.fixture
def frame(tmp_path: Path) -> Path:
    path = tmp_path / "frame.png"
    cv2.imwrite(str(path), np.zeros((SIZE[1], SIZE[0]), np.uint8))
    return path


def table(path: Path, points: ControlPoints, places: FloatArray | None = None, head: str = "X,Y,Z") -> Path:
    places = points.map_m if places is None else places
    rows = [f"{name},{x!r},{y!r},{','.join(repr(float(value)) for value in place)}"
            for name, (x, y), place in zip(points.names, points.image_px.tolist(), places, strict=True)]
    path.write_text("\n".join([f"name,x,y,{head}", *rows]) + "\n", encoding="utf-8")
    return path


def calibration(path: Path) -> Path:
    write_camera_file(path, CameraFile(SCENE.view.camera))
    return path


def refused(capsys: pytest.CaptureFixture[str], *words: object) -> str:
    assert main(["camera", *map(str, words)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    return line


def warnings_of(capsys: pytest.CaptureFixture[str], *words: object) -> str:
    assert main(["camera", *map(str, words)]) == 0
    return capsys.readouterr().err


def test_table_and_file(tmp_path: Path, frame: Path, capsys: pytest.CaptureFixture[str]) -> None:
    gcps, out = table(tmp_path / "g.csv", moved(POINTS, "G4", 0.3, 0.4)), tmp_path / "camera.yaml"
    assert main(["camera", str(gcps), "--image", str(frame), "-o", str(out), "--wse", "0.5"]) == 0
    said = capsys.readouterr()
    assert "point G4 contradicts the others" in said.err
    (line,) = (line for line in said.out.splitlines() if line.startswith("G4"))
    assert line.endswith("wrong")
    file = read_camera_file(out)
    truth = SCENE.view
    assert file.camera.K[0, 0] == pytest.approx(truth.camera.K[0, 0], rel=0.01)
    assert file.pose is not None
    assert file.pose_covariance is not None
    error = file.pose.position_m - truth.pose.position_m
    assert np.all(np.abs(error) < 4 * np.sqrt(np.diag(file.pose_covariance)[:3]))
    assert file.wse_m == 0.5


@pytest.mark.parametrize("crs", ["EPSG:4326", "EPSG:32632", "EPSG:2056"])
def test_points_of_a_reference_system_give_the_camera_in_true_metres(
        crs: str, tmp_path: Path, frame: Path, capsys: pytest.CaptureFixture[str]) -> None:
    to_earth = Transformer.from_pipeline(
        "+proj=pipeline +step +inv +proj=topocentric +ellps=WGS84 +lat_0=46.2 +lon_0=7.3 +h_0=450 "
        "+step +inv +proj=cart +ellps=WGS84 +step +proj=unitconvert +xy_in=rad +xy_out=deg")
    lon, lat, height = np.array(to_earth.transform(*POINTS.map_m.T))
    if crs == "EPSG:4326":
        gcps = table(tmp_path / "g.csv", POINTS, np.column_stack([lat, lon, height]), "lat,lon,height")
        words: list[object] = [gcps]
    else:
        to_crs = Transformer.from_crs("EPSG:4979", crs, always_xy=True)
        gcps = table(tmp_path / "g.csv", POINTS, np.column_stack(to_crs.transform(lon, lat, height)))
        words = [gcps, "--crs", crs]
    out = tmp_path / "camera.yaml"
    assert main(["camera", *map(str, words), "--image", str(frame), "-o", str(out)]) == 0
    capsys.readouterr()
    file = read_camera_file(out)
    assert file.crs == crs
    assert file.frame is not None
    assert file.pose is not None
    lat_lon_height = file.frame.to_geodetic(file.pose.position_m[None])[0]
    lon, lat, height = np.array(to_earth.transform(*SCENE.view.pose.position_m))
    shift = file.frame.from_geodetic(np.array([[lat, lon, height]]))[0] - file.pose.position_m
    assert np.linalg.norm(shift) < 0.3
    assert lat_lon_height[2] == pytest.approx(height, abs=0.3)


@pytest.mark.parametrize(("crs", "unit_m"), [("local", 0.3048), ("EPSG:2227", 1200 / 3937), ("EPSG:32632", 0.3048)])
def test_feet_of_the_header_give_the_camera_in_metres_whatever_the_unit_of_the_system(
        crs: str, unit_m: float, tmp_path: Path, frame: Path, capsys: pytest.CaptureFixture[str]) -> None:
    away = np.array({"local": (0, 0, 0), "EPSG:2227": (1.85e6, 6.4e5, 0), "EPSG:32632": (4.57e5, 4.95e6, 0)}[crs])
    unit = "US ft" if unit_m != 0.3048 else "ft"
    gcps = table(tmp_path / "g.csv", POINTS, (POINTS.map_m + away) / np.array([unit_m, unit_m, 0.3048]),
                 f"X [{unit}],Y [{unit}],Z [ft]")
    out = tmp_path / "camera.yaml"
    said = warnings_of(capsys, gcps, "--image", frame, "--crs", crs, "-o", out)
    assert f"X [{unit}], Y [{unit}], Z [ft] read in the unit that the header names, and made metres" in said
    file = read_camera_file(out)
    assert file.pose is not None
    assert file.pose.position_m[2] == pytest.approx(SCENE.view.pose.position_m[2], abs=0.3)
    if file.frame is not None:
        place = file.frame.to_crs(crs, file.pose.position_m[None])[0] * (unit_m if crs == "EPSG:2227" else 1)
        assert place[:2] == pytest.approx(SCENE.view.pose.position_m[:2] + away[:2], abs=0.5)


def test_feet_of_the_header_are_the_feet_of_the_system(tmp_path: Path, frame: Path,
                                                       capsys: pytest.CaptureFixture[str]) -> None:
    feet = (POINTS.map_m + np.array([2e6, 6.5e5, 0])) / np.array([1200 / 3937, 1200 / 3937, 0.3048])
    places = []
    for unit in ("ft", "US ft", "ft us"):
        gcps = table(tmp_path / "g.csv", POINTS, feet, f"X [{unit}],Y [{unit}],Z [ft]")
        said = warnings_of(capsys, gcps, "--image", frame, "--crs", "EPSG:2227", "-o", tmp_path / f"{unit}.yaml")
        assert ("are taken for those of EPSG:2227, of 0.304800610 m" in said) == (unit == "ft")
        file = read_camera_file(tmp_path / f"{unit}.yaml")
        assert file.frame is not None
        assert file.pose is not None
        places.append(file.frame.to_crs("EPSG:2227", file.pose.position_m[None])[0])
    assert places[0] == pytest.approx(places[1], abs=1e-3)
    assert places[0] == pytest.approx(places[2], abs=1e-3)


def test_a_projected_system_beside_latitudes_and_longitudes_is_that_of_orthophotos(
        tmp_path: Path, frame: Path, capsys: pytest.CaptureFixture[str]) -> None:
    here = LocalFrame(46.2, 7.3, 0.0)
    gcps = table(tmp_path / "g.csv", POINTS, here.to_geodetic(POINTS.map_m), "lat,lon,height")
    files: list[CameraFile] = []
    more: tuple[list[str], ...] = ([], ["--crs", "EPSG:32632"])
    for words in more:
        out = tmp_path / f"{len(files)}.yaml"
        assert "elsewhere" not in warnings_of(capsys, gcps, "--image", frame, "-o", out, *words)
        files.append(read_camera_file(out))
    plain, projected = files
    assert plain.pose is not None
    assert projected.pose is not None
    assert (plain.pose.position_m == projected.pose.position_m).all()
    assert (plain.crs, projected.crs) == ("EPSG:4326", "EPSG:32632")
    assert plain.frame == projected.frame


def test_latitudes_and_longitudes_are_no_eastings_and_northings() -> None:
    with pytest.raises(InputError, match="EPSG:32632 has eastings and northings, and the points latitudes"):
        placed(POINTS.names, POINTS.image_px, POINTS.map_m, "EPSG:32632", geographic=True)


def test_coordinates_far_from_where_the_system_is_used_are_doubted(tmp_path: Path, frame: Path,
                                                                  capsys: pytest.CaptureFixture[str]) -> None:
    known = calibration(tmp_path / "c.yaml")
    feet = POINTS.map_m / np.array([1200 / 3937, 1200 / 3937, 1])
    right, wrong = (table(tmp_path / name, POINTS, feet + np.array(away)) for name, away in (
        ("right.csv", [6.07e6, 2.1e6, 0]), ("wrong.csv", [1.85e6, 6.4e5, 0])))  # feet, and the same in metres
    base = ("--image", frame, "--camera", known, "--crs", "EPSG:2227")
    assert "is used elsewhere: they must be its easting and northing, in the unit US survey foot" in warnings_of(
        capsys, wrong, *base)
    assert "used elsewhere" not in warnings_of(capsys, right, *base)


def test_known_camera_plane_and_nominal_profile(tmp_path: Path, frame: Path,
                                                capsys: pytest.CaptureFixture[str]) -> None:
    gcps = table(tmp_path / "g.csv", POINTS)
    assert main(["camera", str(gcps), "--image", str(frame), "--camera", str(calibration(tmp_path / "c.yaml"))]) == 0
    assert "given" in capsys.readouterr().out
    flat = Scene(relief_m=0).points(6, 0.2, np.random.default_rng(2))
    assert main(["camera", str(table(tmp_path / "f.csv", flat)), "--image", str(frame), "--plane", "--wse", "0"]) == 0
    assert "map_H_image" in capsys.readouterr().out
    warned = warnings_of(capsys, gcps, "--image", frame, "--camera", "dji_phantom_4_pro")
    assert "data sheet" in warned


def test_bad_points_are_said_in_one_line(tmp_path: Path, frame: Path, capsys: pytest.CaptureFixture[str]) -> None:
    known = calibration(tmp_path / "c.yaml")
    outside = ControlPoints(POINTS.names, POINTS.image_px + np.array([600.0, 0]), POINTS.map_m)
    assert "lies outside the 1920x1080 picture" in refused(capsys, table(tmp_path / "g.csv", outside), "--image", frame)
    three = POINTS.where(np.arange(9) < 3)
    assert "3 control points, there must be at least 6" in refused(
        capsys, table(tmp_path / "g.csv", three), "--image", frame)
    t = np.linspace(0, 1, 7)[:, None]
    places = (1 - t) * POINTS.map_m[0] + t * POINTS.map_m[1]
    line = ControlPoints(POINTS.names[:7], SCENE.view.project(places), places)
    assert "on a line" in refused(capsys, table(tmp_path / "g.csv", line), "--image", frame, "--camera", known)
    good = table(tmp_path / "g.csv", POINTS)
    assert "water surface at 90 m is not below the camera" in refused(capsys, good, "--image", frame, "--wse", 90)
    assert "No such file" in refused(capsys, tmp_path / "none.csv", "--image", frame)
    assert "No such file or directory; it must be the picture" in refused(
        capsys, good, "--image", tmp_path / "none.png")


def test_nadir_points_of_one_plane_are_refused_with_advice_and_fitted_to_a_profile(
        tmp_path: Path, frame: Path, capsys: pytest.CaptureFixture[str]) -> None:
    flat = table(tmp_path / "g.csv", Scene(relief_m=0, pitch_rad=np.pi / 2).points(8, 0.2, np.random.default_rng(5)))
    line = refused(capsys, flat, "--image", frame)
    assert "do not tell the focal length" in line
    assert "--plane" in line
    warned = warnings_of(capsys, flat, "--image", frame, "--camera", "dji_mavic_2_pro")
    assert "the nominal focal length is taken as it is" in warned


@pytest.mark.parametrize("relief_m", [0.0, 6.0])
def test_swapped_latitude_and_longitude_are_said(relief_m: float, tmp_path: Path, frame: Path,
                                                 capsys: pytest.CaptureFixture[str]) -> None:
    points = Scene(relief_m=relief_m).points(9, 0.2, np.random.default_rng(3))
    known = calibration(tmp_path / "c.yaml")
    swapped = table(tmp_path / "g.csv", points, points.map_m[:, [1, 0, 2]])
    assert "swapped" in refused(capsys, swapped, "--image", frame, "--camera", known)
    east, north, up = points.map_m.T
    lat_lon = np.column_stack([46.2 + north / 111_160, 7.3 + east / 77_170, up])
    wrong = table(tmp_path / "g.csv", points, lat_lon, "lon,lat,height")
    assert "swapped" in refused(capsys, wrong, "--image", frame, "--camera", known)


def test_swapped_latitude_and_longitude_are_said_without_a_camera_too(tmp_path: Path, frame: Path,
                                                                     capsys: pytest.CaptureFixture[str]) -> None:
    """Where degrees of both differ in length, so that swapped places are no mirror image."""
    east, north, up = POINTS.map_m.T
    lon_lat = np.column_stack([7.3 + east / 77_170, 46.2 + north / 111_160, up + 200])
    gcps = table(tmp_path / "g.csv", POINTS, lon_lat, "lat,lon,height")
    known = calibration(tmp_path / "c.yaml")
    more: tuple[list[object], ...] = ([], ["--camera", known], ["--camera", known, "--height", 45])
    for words in more:
        line = refused(capsys, gcps, "--image", frame, *words)
        assert "latitude and longitude) seem to be swapped: read so, the points fit within 0." in line


@pytest.mark.parametrize("words", [[], ["--plane"]])
def test_degrees_are_not_taken_for_metres(words: list[str], tmp_path: Path, frame: Path,
                                          capsys: pytest.CaptureFixture[str]) -> None:
    flat = Scene(relief_m=0).points(8, 0.2, np.random.default_rng(2))
    east, north, up = flat.map_m.T
    degrees = np.column_stack([7.3 + east / 77_170, 46.2 + north / 111_160, up])
    for columns in ([0, 1, 2], [1, 0, 2]):
        gcps = table(tmp_path / "g.csv", flat, degrees[:, columns])
        assert "look like degrees, they must be metres; name their columns lat and lon" in refused(
            capsys, gcps, "--image", frame, *words)
    small = table(tmp_path / "s.csv", flat, flat.map_m / 1e4)  # a model on a table
    assert "degrees, they must" not in warnings_of(capsys, small, "--image", frame, "--plane")


def test_a_camera_below_all_points_is_refused_unless_the_water_is_below_it(tmp_path: Path, frame: Path,
                                                                         capsys: pytest.CaptureFixture[str]) -> None:
    lens = SCENE.view.camera
    low = View(lens, Pose.of_angles(np.array([0.0, 0, 1]), 0.3, -0.35, 0.1))
    places = np.array([[30.0, -5, 6], [40, 20, 12], [25, 8, 9], [35, 15, 30], [30, 0, 18], [45, 5, 20], [28, 14, 4]])
    points = ControlPoints(tuple("ABCDEFG"), low.project(places), places)
    gcps, known = table(tmp_path / "g.csv", points), calibration(tmp_path / "c.yaml")
    line = refused(capsys, gcps, "--image", frame, "--camera", known)
    assert "the points put the camera at 1.00 m, below all of them (the lowest at 4.00 m)" in line
    assert "below all of them" in warnings_of(capsys, gcps, "--image", frame, "--camera", known, "--wse", 0)


def test_feet_are_said(tmp_path: Path, frame: Path, capsys: pytest.CaptureFixture[str]) -> None:
    known = calibration(tmp_path / "c.yaml")
    feet = table(tmp_path / "feet.csv", POINTS, POINTS.map_m / 0.3048)
    base = (feet, "--image", frame, "--camera", known)
    assert "seem to be in feet" in warnings_of(capsys, *base, "--height", 45)
    distance = float(np.linalg.norm(POINTS.map_m[0] - POINTS.map_m[1]))
    assert "seem to be in feet" in warnings_of(capsys, *base, "--distance", f"G1,G2,{distance:.2f}")
    place = ",".join(f"{value:.3f}" for value in SCENE.view.pose.position_m)
    assert "seem to be in feet" in warnings_of(capsys, *base, f"--position={place}", "--position-sigma", 5)
    assert "seem to be in feet" in refused(capsys, feet, "--image", frame, f"--position={place}")
    heights = table(tmp_path / "z.csv", POINTS, POINTS.map_m / np.array([1, 1, 0.3048]))
    assert "heights seem to be in feet" in refused(capsys, heights, "--image", frame, "--camera", known)


def test_a_wrong_position_is_said(tmp_path: Path, frame: Path, capsys: pytest.CaptureFixture[str]) -> None:
    place = ",".join(f"{value:.3f}" for value in SCENE.view.pose.position_m + np.array([3.0, -2, 4]))
    warned = warnings_of(capsys, table(tmp_path / "g.csv", POINTS), "--image", frame, f"--position={place}")
    assert "m away from the position that was given" in warned


def test_output_is_not_overwritten(tmp_path: Path, frame: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "camera.yaml"
    out.write_text("mine", encoding="utf-8")
    assert "--force" in refused(capsys, table(tmp_path / "g.csv", POINTS), "--image", frame, "-o", out)
    assert out.read_text(encoding="utf-8") == "mine"


def test_a_point_far_from_the_others_is_named(tmp_path: Path, frame: Path, capsys: pytest.CaptureFixture[str]) -> None:
    places = POINTS.map_m.copy()
    places[2, 0] = 1e300
    assert "control point 'G3' is 1e+297 km away from the others" in refused(
        capsys, table(tmp_path / "far.csv", POINTS, places), "--image", frame)
