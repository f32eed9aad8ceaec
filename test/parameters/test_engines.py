"""The engine of georeferencing as parameters and files make it: which of them counts."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from stab_ros.core.settings import Value
from stab_ros.imaging.camera import Camera
from stab_ros.imaging.pose import Pose
from stab_ros.io.camera_file import CameraFile, write_camera_file
from stab_ros.parameters.engines import make_georeferencer

CAMERA = Camera(np.array([[500.0, 0, 319.5], [0, 500, 179.5], [0, 0, 1]]), np.zeros(5), "plumb_bob", (640, 360))
POSE = Pose.of_angles(np.array([2.0, -30, 325]), 1.4, math.radians(50), 0.02)


@pytest.mark.parametrize(("given", "used_m"), [({}, 305.0), ({"wse_m": 0.0}, 0.0), ({"wse_m": 301.5}, 301.5)])
def test_a_level_that_is_given_counts_for_more_than_that_of_the_file(
        given: dict[str, Value], used_m: float, tmp_path: Path) -> None:
    write_camera_file(tmp_path / "camera.yaml", CameraFile(CAMERA, pose=POSE, wse_m=305.0))
    values = {"orientation": "stationary_gcps", "camera_file": str(tmp_path / "camera.yaml"), **given}
    assert make_georeferencer(values, None, CAMERA.size).wse_m == used_m
