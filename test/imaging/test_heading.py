"""Angles of drones against scipy's rotations and the third paper's angles."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from stab_ros.imaging.heading import map_R_body
from stab_ros.imaging.pose import BODY_R_OPTICAL, angles_of

ANGLE = st.floats(-3.1, 3.1)
NED_TO_ENU = np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, -1]])


@settings(deadline=None, derandomize=True)
@given(ANGLE, st.floats(-1.5, 1.5), ANGLE)
def test_angles_are_those_of_aviation(heading: float, pitch: float, roll: float) -> None:
    aviation = Rotation.from_euler("ZYX", [heading, pitch, roll]).as_matrix()
    expected = NED_TO_ENU @ aviation @ np.diag([1.0, -1, -1])
    np.testing.assert_allclose(map_R_body(heading, pitch, roll), expected, atol=1e-12)


@settings(deadline=None, derandomize=True)
@given(st.floats(-3.1, 3.1), st.floats(-1.5, 1.5))
def test_a_camera_looks_along_the_body(heading: float, pitch: float) -> None:
    """Yaw of the paper is from east, against the clock; its pitch is downwards."""
    cam_R_map = (map_R_body(heading, pitch, 0) @ BODY_R_OPTICAL).T
    yaw, down, roll = angles_of(cam_R_map)
    assert math.cos(yaw - (math.pi / 2 - heading)) == pytest.approx(1, abs=1e-9)
    assert down == pytest.approx(-pitch, abs=1e-9)
    assert roll == pytest.approx(0, abs=1e-9)


@pytest.mark.parametrize(("angles_deg", "body", "in_map"), [
    ((0, 0, 0), [1, 0, 0], [0, 1, 0]), ((90, 0, 0), [1, 0, 0], [1, 0, 0]), ((0, -90, 0), [1, 0, 0], [0, 0, -1]),
    ((0, -90, 0), [0, 0, 1], [0, 1, 0]), ((90, -90, 0), [0, 0, 1], [1, 0, 0]), ((0, 0, 90), [0, 1, 0], [0, 0, 1])])
def test_known_directions(angles_deg: tuple[float, ...], body: list[float], in_map: list[float]) -> None:
    """North ahead, east ahead, nadir with north at the top, rolled to the right: the left side goes up."""
    R = map_R_body(*map(math.radians, angles_deg))
    np.testing.assert_allclose(R @ body, in_map, atol=1e-12)
