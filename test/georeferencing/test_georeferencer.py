"""The engine, against the pose that made the pictures."""

import math

import numpy as np
import pytest

from stab_ros.core.errors import InputError
from stab_ros.core.geometry import apply
from stab_ros.core.types import Frame
from stab_ros.georeferencing.georeferencer import Georeferencer
from stab_ros.georeferencing.orientation import Unplaced
from stab_ros.imaging.camera import Camera
from stab_ros.imaging.pose import Pose
from stab_ros.imaging.view import View
from stab_ros.parameters.engines import make_georeferencer

CAMERA = Camera(np.array([[1500.0, 0, 959.5], [0, 1500, 539.5], [0, 0, 1]]), np.zeros(5), "plumb_bob", (1920, 1080))
SECOND_NS = 10**9


def _nadir(**values: bool | float | str) -> Georeferencer:
    return make_georeferencer({"orientation": "stationary_nadir", "height_m": 46.0, **values}, CAMERA, CAMERA.size)


def _frame(stamp_ns: int = SECOND_NS) -> Frame:
    return Frame(np.zeros((1080, 1920), np.uint8), "mono8", stamp_ns)


def test_nadir_is_exact_on_the_pinhole() -> None:
    answer = _nadir(yaw_rad=0.7, wse_m=12.5).frame(_frame())
    assert answer.placement is not None
    view = View(CAMERA, Pose.of_angles(np.array([0, 0, 58.5]), 0.7, math.pi / 2, 0.0))
    pixels = np.array([[0.0, 0], [1919, 0], [5, 1079], [959.5, 539.5], [1200.25, 33]])
    assert np.abs(apply(answer.placement.map_H_image, pixels) - view.to_plane(pixels, 12.5)).max() < 1e-9
    assert answer.placement.values["gsd_m"] == pytest.approx(46 / 1500)
    assert answer.placement.values["sigma_m"] == pytest.approx(  # of the height and of the level, along the ray
        math.hypot(0.1, 0.02) * np.median(np.hypot(*np.meshgrid(
            np.linspace(-959.5, 959.5, 33), np.linspace(-539.5, 539.5, 33)))) / 1500, rel=1e-3)


def test_the_level_of_the_water_holds_from_its_stamp_on() -> None:
    engine = _nadir()
    engine.set_water_level(2 * SECOND_NS, 1.0)
    engine.set_water_level(4 * SECOND_NS, 2.0)
    found = [engine.frame(_frame(second * SECOND_NS)) for second in (1, 2, 3, 4)]
    assert [one.wse_m for one in found] == [0.0, 1.0, 1.0, 2.0]
    assert [one.placement.values["gsd_m"] for one in found if one.placement] == pytest.approx(
        [46 / 1500, 45 / 1500, 45 / 1500, 44 / 1500])


def test_the_grid_stays_that_of_the_first_frame() -> None:
    engine = _nadir()
    engine.set_water_level(2 * SECOND_NS, 20.0)
    first, second = engine.frame(_frame(SECOND_NS)), engine.frame(_frame(2 * SECOND_NS))
    assert first.grid is not None
    assert first.grid is second.grid
    assert first.grid.size == pytest.approx((1920, 1080), abs=2)
    assert second.ortho_H_image is not None
    centre = apply(second.ortho_H_image, np.array([[959.5, 539.5]]))
    np.testing.assert_allclose(apply(second.grid.map_H_ortho, centre), [[0, 0]], atol=1e-9)


def test_water_above_the_camera_is_said() -> None:
    answer = _nadir(wse_m=0.0)
    answer.set_water_level(0, 50.0)
    found = answer.frame(_frame())
    assert isinstance(found.answer, Unplaced)
    assert found.reason.startswith("the water surface at 50 m is not below the camera at 46 m")
    assert answer.orthophoto(found) is None


def test_a_frame_of_another_size_is_refused() -> None:
    with pytest.raises(InputError, match="takes images of 1920x1080, not 960x540"):
        _nadir().frame(Frame(np.zeros((540, 960), np.uint8), "mono8", 0))


def test_an_extent_and_a_resolution_are_taken() -> None:
    answer = _nadir(extent="-10, -5, 20, 15", resolution_m=0.05).frame(_frame())
    assert answer.grid is not None
    assert answer.grid.size == (600, 400)
    assert (answer.grid.west_m, answer.grid.north_m) == pytest.approx((-10, 15))
