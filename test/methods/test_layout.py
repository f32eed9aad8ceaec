"""Automatic and given points of the template methods: where they lie, and how far apart."""

from __future__ import annotations

import numpy as np
from truth import SIZE, picture

from stab_ros.methods import _layout

EVERYWHERE = np.ones(SIZE[::-1], bool)


def test_places_given_are_kept_to_half_a_pixel() -> None:
    points = np.array([[100.2, 50.7], [33.5, 20.0]])
    for side in (32, 21):
        centres = _layout.user_points(points, side)
        assert np.abs(centres - points).max() <= 0.5
        corners = centres - (side - 1) / 2
        np.testing.assert_array_equal(corners, np.round(corners))


def test_one_place_near_each_corner_of_what_is_allowed() -> None:
    allowed = EVERYWHERE.copy()
    allowed[:, :150] = False
    places = _layout.corners(picture(), allowed, 4, 32, 16, 0.5)
    np.testing.assert_allclose(places, [[150, 16], [400, 16], [150, 284], [400, 284]], atol=75)
    assert all(allowed[int(y), int(x)] for x, y in places)
    assert _layout.corners(picture(), np.zeros_like(allowed), 4, 32, 16, 0.5).shape == (0, 2)


def test_places_apart_keep_their_distance_and_margin() -> None:
    places = _layout.strongest_corners(picture(), EVERYWHERE, 50, 21, 16, 60.0)
    assert 5 <= len(places) <= 30
    apart = np.hypot(*(places[:, None] - places[None]).T) + 1e9 * np.eye(len(places))
    assert apart.min() >= 59
    assert (places >= 16).all()
    assert (places <= np.array(SIZE) - 17).all()
