"""Pixels above the horizon, against the pose."""

import math

import numpy as np
import pytest

from stab_ros.core.geometry import apply
from stab_ros.georeferencing.horizon import gsd_m, in_front, shown_well
from stab_ros.georeferencing.posed import map_H_image_of
from stab_ros.imaging.camera import Camera
from stab_ros.imaging.pose import Pose
from stab_ros.imaging.view import View

CAMERA = Camera(np.array([[1500.0, 0, 959.5], [0, 1500, 539.5], [0, 0, 1]]), np.zeros(5), "plumb_bob", (1920, 1080))
PIXELS = np.stack(np.meshgrid(np.linspace(0, 1919, 13), np.linspace(0, 1079, 11)), axis=-1).reshape(-1, 2)


@pytest.mark.parametrize("pitch_deg", [90, 45, 20, 5])
@pytest.mark.parametrize("roll_deg", [0, 30, 180])
def test_pixels_are_in_front_exactly_where_rays_reach_the_plane(pitch_deg: float, roll_deg: float) -> None:
    view = View(CAMERA, Pose.of_angles(np.array([3.0, -4, 46]), 0.3, math.radians(pitch_deg), math.radians(roll_deg)))
    seen = np.isfinite(view.to_plane(PIXELS, 1.0)).all(axis=1)
    H = map_H_image_of(CAMERA, view.pose, 1.0)
    assert (in_front(H, PIXELS) == seen).all()
    assert in_front(H, PIXELS).any()
    near = view.gsd_m(PIXELS, 1.0) < 5.0  # beyond, half a pixel is no small step
    np.testing.assert_allclose(gsd_m(H, PIXELS)[near], view.gsd_m(PIXELS, 1.0)[near], rtol=1e-4)


def test_what_is_much_coarser_is_left_out() -> None:
    view = View(CAMERA, Pose.of_angles(np.array([0.0, 0, 46]), 0.0, math.radians(10), 0.0))
    H = map_H_image_of(CAMERA, view.pose, 0.0)
    outline = apply(H, shown_well(H, PIXELS))
    assert outline[:, 0].min() > 0
    assert outline[:, 0].max() < 46 / math.tan(math.radians(4))
