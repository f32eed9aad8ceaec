"""Coordinates that could be read in another way: only where that explains all points."""

from __future__ import annotations

import numpy as np
import pytest
from control_scene import Scene

from stab_ros.core.types import Frame
from stab_ros.georeferencing.control_points import ControlPoints
from stab_ros.georeferencing.georeferencer import Georeferencer
from stab_ros.georeferencing.orientations import make_orientation
from stab_ros.georeferencing.sensors import Sensors
from stab_ros.georeferencing.settings import GeoreferenceConfig

SCENE = Scene((3840, 2160), relief_m=0.6)
CONFIG = GeoreferenceConfig(orientation="stationary_gcps")


def _engine(points: ControlPoints, calibrated: bool = True) -> Georeferencer:
    camera = SCENE.view.camera
    return Georeferencer(CONFIG, camera, make_orientation(CONFIG, camera, calibrated, points), Sensors(0.0))


@pytest.mark.parametrize("calibrated", [True, False])
def test_two_points_marked_wrongly_are_named_where_heights_hardly_matter(calibrated: bool) -> None:
    """In feet, heights of +-0.3 m are 0.2 m off, 5 px: no explanation of two points that are 12 px off."""
    points = SCENE.points(12, 0.3, np.random.default_rng(0))
    pixels = points.image_px.copy()
    pixels[[3, 7]] += [[11.0, 5.0], [-7.0, 10.0]]
    answer = _engine(ControlPoints(points.names, pixels, points.map_m), calibrated).frame(
        Frame(np.zeros((2160, 3840), np.uint8), "mono8", 1))
    assert answer.placement is not None
    assert set(answer.placement.rejected) == {"G4", "G8"}
    assert answer.placement.values["rmse_px"] < 0.5
