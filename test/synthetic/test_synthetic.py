"""The renderer: its truth against independent oracles, its pictures, its presets, and the sample made with it."""

from __future__ import annotations

import csv
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from mcap.reader import make_reader

from stab_ros.core.errors import InputError
from stab_ros.core.geometry import apply
from stab_ros.core.types import FloatArray, Image
from stab_ros.synthetic.camera_path import Gust, Motion, PinholeCamera, Pose
from stab_ros.synthetic.flight import Flight, SceneSettings, preset

BAGS = Path(__file__).resolve().parents[2] / "bags"
SIZE = (480, 270)
UNMOVED = Pose()
STILL_CAMERA = Motion(sway=UNMOVED, sway_hz=0.1)
ALPINE = preset("alpine")


def calm(scene: SceneSettings, move: Pose = UNMOVED) -> SceneSettings:
    """Without noise and brightness changes, short; between frame 0 and frame 1 the camera makes `move`."""
    gust = Gust(0.0, 1 / scene.fps, move)
    motion = replace(STILL_CAMERA, gusts=(gust,))
    return replace(scene, motion=motion, noise_levels=0.0, brightness=0.0, duration_s=0.1)


def dry(scene: SceneSettings) -> SceneSettings:
    """The river flows outside the picture."""
    return replace(scene, stream=replace(scene.stream, centre=9.0, width=0.1), islands=())


def shifted(image: Image, x_px: float, y_px: float) -> FloatArray:
    """The picture moved to the right and down by a windowed sinc, far sharper than any warp."""
    taps = np.arange(-24, 25)
    moved = image.astype(np.float64)
    for axis, shift in ((1, x_px), (0, y_px)):
        window = np.i0(8 * np.sqrt(1 - ((taps - shift) / 25) ** 2)) / np.i0(8)
        kernel = np.sinc(taps - shift) * window
        moved = np.apply_along_axis(np.convolve, axis, moved, kernel / kernel.sum(), "same")
    return moved


def misfit(expected: FloatArray, found: FloatArray) -> FloatArray:
    """By how much `found` lies to the right of and below `expected`, px, by least squares over the inner part."""
    inner = np.s_[40:-40, 40:-40]
    gy, gx = (np.gradient(expected, axis=axis)[inner].ravel() for axis in (0, 1))
    design = -np.stack([gx, gy], axis=1)
    return np.asarray(np.linalg.lstsq(design, (found - expected)[inner].ravel(), rcond=None)[0])


@pytest.mark.parametrize(("x_px", "y_px"), [(0.25, 0.0), (0.5, 0.5), (0.37, -0.81), (-0.125, 0.3)])
def test_subpixel_truth_is_unbiased(x_px: float, y_px: float) -> None:
    gsd_m = ALPINE.ground_m[0] / SIZE[0]
    flight = Flight(calm(dry(ALPINE), Pose(x_m=-x_px * gsd_m, y_m=-y_px * gsd_m)), SIZE, frames=2, seed=5)
    expected = np.array([[1, 0, -x_px], [0, 1, -y_px], [0, 0, 1]])
    np.testing.assert_allclose(flight.ref_H_cur(1), expected, atol=1e-9)
    assert np.abs(misfit(shifted(flight[0].image, x_px, y_px), flight[1].image.astype(float))).max() < 0.003


@pytest.mark.parametrize("name", ["kolubara", "alpine"])
def test_control_points_lie_where_the_truth_says(name: str) -> None:
    scene = replace(preset(name), noise_levels=0.0, tracers_per_m2=0.0)
    flight = Flight(scene, (scene.size[0] // 2, scene.size[1] // 2), frames=12, seed=2)
    shot = flight[11]
    current = apply(np.linalg.inv(shot.ref_H_cur), flight.control_points_px)
    corners = current[:, None].astype(np.float32).copy()
    criteria = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 50, 0.001)
    cv2.cornerSubPix(shot.image, corners, (3, 3), (-1, -1), criteria)
    assert np.abs(corners[:, 0] - current).max() < 0.1


def test_homography_is_that_of_a_pinhole_camera() -> None:
    pose = Pose(x_m=3.0, y_m=-2.0, height_m=40.0, yaw_deg=12.0, pitch_deg=-4.0, roll_deg=7.0)
    camera = PinholeCamera((640, 480), 500.0)
    turns = (np.radians(-pose.roll_deg) * np.eye(3)[1], np.radians(-pose.pitch_deg) * np.eye(3)[0],
             np.radians(-pose.yaw_deg) * np.eye(3)[2])
    roll, pitch, yaw = (cv2.Rodrigues(turn)[0] for turn in turns)
    R = roll @ pitch @ yaw
    centre = np.array([pose.x_m, pose.y_m, -pose.height_m])
    ground = np.array([[0.0, 0, 0], [5, 8, 0], [-7, 3, 0], [2, -9, 0]])
    seen, _ = cv2.projectPoints(ground, cv2.Rodrigues(R)[0], -R @ centre, camera.K, None)
    np.testing.assert_allclose(apply(camera.image_H_plane(pose), ground[:, :2]), seen[:, 0], atol=1e-9)


def test_moving_right_moves_the_ground_left() -> None:
    flight = Flight(calm(ALPINE, Pose(x_m=1.0)), SIZE, frames=2)
    assert flight.ref_H_cur(1)[0, 2] > 5  # what is at x now was further right in the reference
    assert flight.ref_H_cur(1)[1, 2] == pytest.approx(0, abs=1e-9)


def test_the_same_seed_gives_the_same_bytes_and_a_longer_flight_begins_alike() -> None:
    short, long = (Flight(ALPINE, SIZE, frames=n, seed=4) for n in (3, 9))
    for a, b in zip(short, long, strict=False):
        np.testing.assert_array_equal(a.image, b.image)
        np.testing.assert_array_equal(a.ref_H_cur, b.ref_H_cur)
        assert a.stamp_ns == b.stamp_ns
    assert not np.array_equal(short[0].image, Flight(ALPINE, SIZE, frames=1, seed=5)[0].image)


def test_ground_stands_and_water_moves_with_the_stream() -> None:
    scene = calm(replace(ALPINE, islands=(), tracers_per_m2=0.0))
    flight = Flight(scene, SIZE, frames=2, seed=3)
    before, after = (flight[i].image.astype(float) for i in (0, 1))
    assert np.abs(after - before)[~flight.water].max() <= 1
    middle = np.s_[125:145, 120:360]
    profile = [np.abs(before[middle] - np.roll(after, -s, axis=1)[middle]).mean() for s in range(8)]
    gsd_m = scene.ground_m[0] / SIZE[0]
    assert np.argmin(profile) == pytest.approx(scene.stream.speed_m_s / scene.fps / gsd_m, abs=1)


def test_water_share_follows_the_preset() -> None:
    flight = Flight(replace(ALPINE, islands=()), SIZE, frames=1)
    assert flight.water.mean() == pytest.approx(ALPINE.stream.width, abs=0.08)
    assert not flight.water[tuple(flight.control_points_px.round().astype(int).T[::-1])].any()


def test_noise_has_the_preset_strength() -> None:
    scene = dry(replace(ALPINE, motion=STILL_CAMERA, brightness=0.0, noise_levels=3.0))
    a, b = (shot.image.astype(float) for shot in Flight(scene, SIZE, frames=2))
    assert (a - b).std() == pytest.approx(3.0 * np.sqrt(2), rel=0.05)


def test_brightness_wanders() -> None:
    scene = dry(replace(ALPINE, motion=STILL_CAMERA, brightness=0.1))
    means = [shot.image.mean() for shot in Flight(scene, SIZE, frames=8)]
    assert np.ptp(means) > 5


def test_colour_pictures_have_the_same_truth() -> None:
    grey, colour = (Flight(ALPINE, SIZE, frames=2, color=color) for color in (False, True))
    assert colour[1].image.shape == (SIZE[1], SIZE[0], 3)
    np.testing.assert_array_equal(grey[1].ref_H_cur, colour[1].ref_H_cur)


def test_a_still_becomes_the_ground() -> None:
    noise = np.random.default_rng(1).integers(0, 256, (270, 480), np.uint8)
    still = cv2.normalize(cv2.GaussianBlur(noise, (0, 0), 4), None, 0, 255, cv2.NORM_MINMAX)
    scene = replace(calm(dry(ALPINE)), control_points=())
    image = Flight(scene, SIZE, frames=1, still=still)[0].image
    assert np.corrcoef(image.ravel(), still.ravel())[0, 1] > 0.98


@pytest.mark.parametrize(
    ("name", "size", "gsd_m", "fps", "points"),
    [("kolubara", (4096, 2160), 0.010, 23.0, 6), ("alpine", (3840, 2160), 0.021, 5.0, 8),
     ("basento", (1920, 1080), 0.005, 23.98, 0)],
)
def test_presets_are_the_case_studies(name: str, size: tuple[int, int], gsd_m: float, fps: float, points: int) -> None:
    found = preset(name)  # Ljubicic et al. 2021, table 1
    assert (found.size, found.gsd_m, found.fps, len(found.control_points)) == (size, gsd_m, fps, points)


def test_kolubara_moves_by_a_few_to_some_tens_of_pixels() -> None:
    flight = Flight(preset("kolubara"), (512, 270), frames=721)
    corners = np.array([[0, 0], [511, 0], [0, 269], [511, 269.0]])
    moved = [np.abs(apply(flight.ref_H_cur(i), corners) - corners).max() * 8 for i in range(0, 721, 10)]
    assert 10 < max(moved) < 80


def test_basento_loses_a_bank() -> None:
    flight = Flight(preset("basento"), (240, 135), frames=900)
    lowest = min(float(apply(flight.ref_H_cur(i), np.array([[120.0, 134.0]]))[0, 1]) for i in range(0, 900, 20))
    assert lowest < 0.85 * 134  # the lower edge then looks at what was water


def test_bad_arguments_are_refused() -> None:
    with pytest.raises(InputError, match="32x270 px, it must be at least 64x64"):
        Flight(ALPINE, (32, 270))
    with pytest.raises(InputError, match="0 frames, it must have at least 1"):
        Flight(ALPINE, SIZE, frames=0)
    with pytest.raises(InputError, match="it must be \\(h, w\\) uint8"):
        Flight(ALPINE, SIZE, still=np.zeros((9, 9, 3), np.uint8))


def test_unknown_preset_is_refused_with_the_names() -> None:
    with pytest.raises(InputError, match="kolubara, alpine, basento"):
        preset("danube")


@pytest.mark.thorough
def test_sample_is_made_again_bit_for_bit(tmp_path: Path) -> None:
    subprocess.run([sys.executable, str(BAGS / "make_sample.py"), str(tmp_path)], check=True, timeout=300)
    for name in ("sample.mcap", "sample_truth.csv", "sample_water.csv"):
        assert (tmp_path / name).read_bytes() == (BAGS / name).read_bytes(), name


def test_sample_holds_a_flight_and_its_truth() -> None:
    assert (BAGS / "sample.mcap").stat().st_size < 8_000_000
    with (BAGS / "sample.mcap").open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        topics = [(channel.topic, message.log_time) for _, channel, message in reader.iter_messages()]
    stamps = [stamp for topic, stamp in topics if topic == "/camera/image_raw/compressed"]
    assert {topic for topic, _ in topics} == {"/camera/image_raw/compressed", "/camera/camera_info", "/gps/fix"}
    with (BAGS / "sample_truth.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [int(row["stamp_ns"]) for row in rows] == stamps
    assert len(stamps) >= 60
    assert {row["status"] for row in rows} == {"TRACKED"}
    assert {float(row["h22"]) for row in rows} == {1.0}
