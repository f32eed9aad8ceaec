"""Orthophotos, against the ground that the picture shows and against OpenCV."""

import math

import cv2
import numpy as np
import pytest
from ground_pictures import GroundPictures

from stab_ros.core.types import Frame, Image
from stab_ros.georeferencing.georeferencer import Georeferencer
from stab_ros.georeferencing.ortho_grid import MOST_PIXELS, OrthoGrid
from stab_ros.georeferencing.orthophoto import Orthophotos
from stab_ros.georeferencing.posed import map_H_image_of
from stab_ros.georeferencing.sensors import Sensors
from stab_ros.georeferencing.settings import GeoreferenceConfig
from stab_ros.georeferencing.stationary_gcps import StationaryPose
from stab_ros.imaging.camera import Camera
from stab_ros.imaging.pose import Pose
from stab_ros.imaging.view import View

K = np.array([[750.0, 0, 479.5], [0, 750, 269.5], [0, 0, 1]])
SIZE = (960, 540)
LENSES = {"none": Camera(K, np.zeros(0), "plumb_bob", SIZE),
          "wide": Camera(K, np.array([-0.12, 0.03, 0.001, -0.0005, 0]), "plumb_bob", SIZE)}


def _pose(pitch_deg: float, away_m: float) -> Pose:
    return Pose.of_angles(np.array([1.0, -away_m, 46]), math.pi / 2 + 0.1, math.radians(pitch_deg), 0.03)



@pytest.mark.parametrize("lens", LENSES)
@pytest.mark.parametrize("pitch_deg", [90, 55])
def test_the_ground_is_where_it_is_in_the_map(lens: str, pitch_deg: float) -> None:
    camera, ground = LENSES[lens], GroundPictures()
    view = View(camera, _pose(pitch_deg, 46 / math.tan(math.radians(pitch_deg))))
    grid = OrthoGrid(-12, 9, 0.1, 240, 180)
    ortho = Orthophotos(camera, "linear").make(
        ground.seen_by(view), grid.ortho_H_map @ map_H_image_of(camera, view.pose, 0.0), grid.size)
    texture = cv2.GaussianBlur(ground.texture, (0, 0), 1.6)  # as coarse as the picture
    wanted = cv2.warpPerspective(texture, np.linalg.inv(np.linalg.inv(ground.map_H_texture) @ grid.map_H_ortho),
                                 grid.size)
    shift, _ = cv2.phaseCorrelate(wanted.astype(np.float64), ortho.astype(np.float64))
    assert np.hypot(*shift) * grid.resolution_m < 0.005
    assert np.corrcoef(wanted.ravel(), ortho.ravel())[0, 1] > 0.95


@pytest.mark.parametrize("lens", LENSES)
def test_what_lies_above_the_horizon_is_left_out_and_not_mirrored(lens: str) -> None:
    camera = LENSES[lens]
    pose = Pose.of_angles(np.array([0.0, 0, 10]), math.pi / 2, math.radians(12), 0.0)
    image = np.full((540, 960), 200, np.uint8)
    grid = OrthoGrid(-40, 60, 0.25, 320, 480)  # reaches 60 m behind the camera
    ortho = Orthophotos(camera, "linear").make(image, grid.ortho_H_map @ map_H_image_of(camera, pose, 0.0), grid.size)
    x, y = np.meshgrid(np.arange(320), np.arange(480))
    places = np.stack([x.ravel(), y.ravel(), np.ones(x.size)], axis=1) @ grid.map_H_ortho.T
    pixels = View(camera, pose).project(np.column_stack([places[:, :2], np.zeros(len(places))])).reshape(480, 320, 2)
    inside = ((pixels > 1) & (pixels < np.array(SIZE) - 2)).all(axis=2)
    outside = ~((pixels > -2) & (pixels < np.array(SIZE) + 1)).all(axis=2)
    assert (ortho[inside] == 200).all()
    assert (ortho[outside] == 0).all()
    assert 0.1 < inside.mean() < 0.6


@pytest.mark.parametrize(("encoding", "dtype", "channels"), [
    ("mono8", np.uint8, ()), ("mono16", np.uint16, ()), ("bgr8", np.uint8, (3,)), ("rgba8", np.uint8, (4,)),
    ("32FC1", np.float32, ())])
@pytest.mark.parametrize("lens", LENSES)
def test_colour_and_depth_are_kept(encoding: str, dtype: type, channels: tuple[int, ...], lens: str) -> None:
    image: Image = (np.random.default_rng(0).random((540, 960, *channels)) * 250).astype(dtype)
    engine = Georeferencer(GeoreferenceConfig(), LENSES[lens], StationaryPose(LENSES[lens], _pose(70, 15), None),
                           Sensors(0.0))
    ortho = engine.orthophoto(engine.frame(Frame(image, encoding, 0)))
    assert engine.grid is not None
    assert ortho is not None
    assert ortho.shape == (engine.grid.rows, engine.grid.columns, *channels)
    assert ortho.dtype == dtype
    assert 100 < ortho[ortho > 0].mean() < 150


def test_a_still_camera_gives_the_same_picture_from_the_same_tables() -> None:
    camera = LENSES["wide"]
    image = np.random.default_rng(1).integers(0, 255, (540, 960, 3)).astype(np.uint8)
    H = OrthoGrid(-12, 9, 0.1, 240, 180).ortho_H_map @ map_H_image_of(camera, _pose(70, 15), 0.0)
    photos = Orthophotos(camera, "linear")
    first, again = photos.make(image, H, (240, 180)), photos.make(image, H, (240, 180))
    moved = photos.make(image, H @ np.array([[1, 0, 3.0], [0, 1, 0], [0, 0, 1]]), (240, 180))
    assert (first == again).all()
    assert (first != moved).any()
    exact = camera.rectify(image, H, (240, 180), cv2.INTER_LINEAR)
    assert np.abs(first.astype(int) - exact).max() < 0.02 * 2 * 255  # 0.02 px along x and y, of full contrast


@pytest.mark.parametrize("interpolation", ["linear", "nearest"])
@pytest.mark.parametrize("heading", [0.0, 0.8])
def test_no_pixel_is_displaced_through_a_lens(interpolation: str, heading: float) -> None:
    """A picture of its own coordinates, 64 grey levels a pixel, tells where each pixel of the orthophoto is from."""
    camera = LENSES["wide"]
    pose = Pose.of_angles(np.array([1.0, -5, 46]), math.pi / 2 + heading, math.radians(80), 0.02)
    H = OrthoGrid(-24, 16, 0.0613, 780, 520).ortho_H_map @ map_H_image_of(camera, pose, 0.0)
    x, y = (np.asarray(axis, np.uint16) for axis in np.meshgrid(np.arange(960) * 64 + 64, np.arange(540) * 64 + 64))
    wanted = camera.maps(H, (780, 520))
    for picture, places in zip((x, y), wanted, strict=True):
        found = Orthophotos(camera, interpolation).make(picture, H, (780, 520)).astype(float) / 64 - 1
        inside = (wanted[0] > 2) & (wanted[0] < 957) & (wanted[1] > 2) & (wanted[1] < 537)
        assert inside.mean() > 0.5
        assert np.abs(found - places)[inside].max() < (0.51 if interpolation == "nearest" else 0.02 + 1 / 64)


@pytest.mark.parametrize("lens", LENSES)
def test_a_coarse_orthophoto_shows_means_and_no_moire(lens: str) -> None:
    camera, ground = LENSES[lens], GroundPictures()
    view = View(camera, _pose(90, 0.0))
    map_H_image = map_H_image_of(camera, view.pose, 0.0)
    rng = np.random.default_rng(2)
    picture = np.clip(ground.seen_by(view) * 0.5 + rng.normal(60, 40, (540, 960)), 0, 255).astype(np.uint8)
    fine, coarse = OrthoGrid(-12, 9, 0.1, 240, 180), OrthoGrid(-12, 9, 0.5, 48, 36)
    photos = Orthophotos(camera, "linear")
    image = photos.make(picture, fine.ortho_H_map @ map_H_image, fine.size)
    means = image.reshape(36, 5, 48, 5).mean(axis=(1, 3))
    shown = photos.make(picture, coarse.ortho_H_map @ map_H_image, coarse.size)
    assert np.std(shown - means) < 8  # twice as much without


def test_a_huge_grid_is_made_coarser_by_two() -> None:
    grid = OrthoGrid.covering(np.array([[0.0, 0], [2000, 1000]]), 0.05)
    assert grid.resolution_m == 0.2
    assert grid.columns * grid.rows <= MOST_PIXELS < 4 * grid.columns * grid.rows


@pytest.mark.parametrize(("extent", "resolution_m", "said"), [
    ("-5, -5, 5, 5", 0.1, ()), ("900, 900, 910, 910", 0.1, ("the frame shows nothing of extent",)),
    ("1, 1, 1.4, 1.4", 0.1, ()),  # smaller than the steps in which the frame is looked at
    ("-4e8, -4e8, 4e8, 4e8", 0.1, ("resolution_m 0.1 would take more than 180000000 pixels, the orthophoto has "
                                  "1.049e+05 m",)),
])
def test_what_an_extent_does_not_show_is_said(extent: str, resolution_m: float, said: tuple[str, ...]) -> None:
    camera = LENSES["none"]
    engine = Georeferencer(GeoreferenceConfig(extent=extent, resolution_m=resolution_m), camera,
                           StationaryPose(camera, _pose(85, 4), None), Sensors(0.0))
    answer = engine.frame(Frame(np.zeros((540, 960), np.uint8), "mono8", 0)).placement
    assert answer is not None
    assert answer.warnings == said


def test_a_picture_is_never_halved_to_nothing() -> None:
    camera = LENSES["none"]
    H = OrthoGrid(-1e8, 1e8, 1e5, 2000, 2000).ortho_H_map @ map_H_image_of(camera, _pose(90, 0), 0.0)
    assert Orthophotos(camera, "linear").make(np.full((540, 960), 9, np.uint8), H, (2000, 2000)).max() <= 9
