"""Where a plane's motion takes points, on motions that are known exactly."""

from __future__ import annotations

import numpy as np
import pytest

from stab_ros.core.geometry import apply, shift
from stab_ros.core.types import BoolArray
from stab_ros.tracking.planes import Plane

POINTS_PX = np.array([[10.0, 20.0], [300.0, 40.0], [150.0, 200.0]])
TILTED = np.array([[1.02, 0.01, 5.0], [-0.02, 0.98, -3.0], [1e-5, -2e-5, 1.0]])
UNKNOWN = np.full((3, 3), np.nan)
ALL: BoolArray = np.ones(3, bool)


def test_points_on_a_plane_come_back_from_each_frame_that_knows_it() -> None:
    plane = Plane(ALL, np.stack([shift(-7, 4), UNKNOWN, TILTED, UNKNOWN]))
    current_px = plane.current_px(POINTS_PX)
    assert plane.known.tolist() == [True, False, True, False]
    np.testing.assert_array_equal(plane.last, TILTED)
    np.testing.assert_array_equal(current_px[0], POINTS_PX + np.array([7, -4]))
    np.testing.assert_allclose(apply(TILTED, current_px[2]), POINTS_PX, rtol=0, atol=1e-9)
    np.testing.assert_allclose(plane.reference_px(current_px)[plane.known], [POINTS_PX] * 2, rtol=0, atol=1e-9)
    assert np.isnan(current_px[~plane.known]).all()


def test_how_far_a_plane_has_moved_is_that_of_its_own_features() -> None:
    """At the far right a zoom moves them further than at the left."""
    zoom = np.diag([1 / 1.1, 1.0, 1.0])
    right = Plane(POINTS_PX[:, 0] > 200, np.stack([zoom, UNKNOWN, np.eye(3)]))
    left = Plane(POINTS_PX[:, 0] < 20, right.ref_H_cur)
    assert right.moved_px(POINTS_PX) == pytest.approx(30)
    assert left.moved_px(POINTS_PX) == pytest.approx(1)


def test_planes_are_as_far_apart_as_in_the_worst_frame_that_knows_both() -> None:
    plane = Plane(ALL, np.stack([shift(1, 1), TILTED, shift(90, 0), UNKNOWN]))
    other = Plane(ALL, np.stack([shift(1, 1), shift(3, 4) @ TILTED, UNKNOWN, shift(90, 0)]))
    current_px = np.broadcast_to(POINTS_PX, (4, 3, 2))
    assert plane.apart_px(other, current_px) == pytest.approx(5)
    assert other.apart_px(plane, current_px) == pytest.approx(5)


def test_planes_that_no_frame_shows_together_are_not_one() -> None:
    plane, other = (Plane(ALL, np.stack(pair)) for pair in ([np.eye(3), UNKNOWN], [UNKNOWN, np.eye(3)]))
    assert plane.apart_px(other, np.broadcast_to(POINTS_PX, (2, 3, 2))) == np.inf
