"""The small measures of the evaluation: overlap, brightness, and which points move on their own."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from truth import SIZE, picture, similarity, translation

from stab_ros.core.geometry import apply
from stab_ros.metrics.brightness import brightness
from stab_ros.metrics.overlap import valid_overlap, windows_inside
from stab_ros.metrics.static_points import StaticPoints

GRAY = np.maximum(picture(), 1)


@pytest.mark.parametrize("H", [translation(12.3, -7.6), similarity(4.0, 0.95, 5, 3)])
def test_only_what_warping_filled_from_the_frame_is_valid(H: np.ndarray) -> None:
    white = cv2.warpPerspective(np.full(SIZE[::-1], 200, np.uint8), H, SIZE)
    warped = cv2.warpPerspective(GRAY, H, SIZE)
    inner = np.pad(np.ones((SIZE[1] - 2, SIZE[0] - 2), bool), 1)  # a wedge less than a pixel high is seen by H alone
    for known, where in ((H, np.ones_like(inner)), (None, inner)):
        valid = valid_overlap(warped, known)
        assert (white[valid & where] == 200).all(), "black border is mixed in"
        deep_inside = cv2.copyMakeBorder(white, 1, 1, 1, 1, cv2.BORDER_CONSTANT)
        deep_inside = cv2.erode(deep_inside, np.ones((17, 17), np.uint8))[1:-1, 1:-1] == 200
        assert valid[deep_inside].all(), "more than the border is left out"


def test_a_dark_pixel_is_not_border() -> None:
    dark = GRAY.copy()
    dark[50:53, 60:63] = 0
    assert valid_overlap(dark, None).all()


def test_windows_must_lie_inside() -> None:
    valid = np.ones((100, 120), bool)
    valid[40:42, 50] = False
    centres = np.array([[15, 15], [14, 50], [104, 84], [105, 84], [60, 41], [66, 41], [35, 41], [34, 41]])
    assert windows_inside(valid, centres, 31).tolist() == [True, False, True, False, False, True, False, True]
    assert windows_inside(valid, centres[:0], 31).shape == (0,)


@pytest.mark.parametrize(("gain", "offset"), [(1.05, 0), (1, 8), (0.9, 0), (1, -10)])
def test_a_change_of_brightness_is_measured_and_undone(gain: float, offset: float) -> None:
    a = np.random.default_rng(1).uniform(60, 160, (5, 31, 31))
    found = brightness(a, gain * a + offset)
    assert (found.gain, found.offset) == pytest.approx((gain, offset), abs=1e-9)
    assert found.change == pytest.approx(np.median((gain * a + offset).mean(axis=(1, 2)) / a.mean(axis=(1, 2))) - 1)
    assert found.matched(gain * a + offset) == pytest.approx(a)


def test_blur_and_one_moving_window_are_no_change_of_brightness() -> None:
    a = np.random.default_rng(2).uniform(60, 160, (5, 31, 31))
    b = np.stack([cv2.blur(window, (3, 3)) for window in a])
    b[2] += 60
    found = brightness(a, b)
    assert abs(found.change) < 0.005
    assert abs(found.gain - 1) < 0.01
    assert abs(found.offset) < 0.5


CENTRES = np.array([[x, y] for y in (50, 150, 250) for x in (50, 150, 250, 350)])
ALL = np.ones(len(CENTRES), bool)


def shifts_of(H: np.ndarray) -> np.ndarray:
    """How far H moves the points."""
    return np.asarray(apply(H, CENTRES.astype(float)) - CENTRES)


def test_water_is_voted_out_as_soon_as_it_has_moved() -> None:
    points = StaticPoints(CENTRES)
    assert points.static.all()
    wet = CENTRES[:, 1] == 150
    for index in range(1, 30):
        points.vote(np.where(wet[:, None], [0.3 * index, 0.0], 0.0), ALL)
        assert index < 5 or (points.static == ~wet).all()


def test_ground_that_is_held_badly_moves_as_one() -> None:
    points = StaticPoints(CENTRES)
    for H in (translation(3.0, -2.0), similarity(2.0, 1.02), similarity(-1.0, 0.99, 4.0)):
        points.vote(shifts_of(H), ALL)
    assert points.static.all()


def test_what_moved_only_once_or_long_ago_is_static() -> None:
    points = StaticPoints(CENTRES)
    moved, still = np.zeros((len(CENTRES), 2)), np.zeros((len(CENTRES), 2))
    moved[5] = 2.0
    points.vote(still, ALL)
    points.vote(moved, ALL)
    assert points.static.all()
    points.vote(moved, ALL)
    assert np.flatnonzero(~points.static).tolist() == [5]
    for _ in range(6):
        points.vote(still, ALL)
    assert points.static.all()


def test_the_first_frame_counts_alone() -> None:
    points = StaticPoints(CENTRES)
    moved, still = np.zeros((len(CENTRES), 2)), np.zeros((len(CENTRES), 2))
    moved[5] = 2.0
    points.vote(moved, ALL)
    assert np.flatnonzero(~points.static).tolist() == [5]
    points.vote(still, ALL)
    assert points.static.all()


def test_what_is_not_found_again_moves_unless_little_is_found_at_all() -> None:
    points = StaticPoints(CENTRES)
    gone, dark = np.zeros((len(CENTRES), 2)), np.full((len(CENTRES), 2), np.nan)
    gone[3] = np.nan
    for _ in range(3):
        points.vote(dark, ALL)
    assert points.static.all()
    for _ in range(2):
        points.vote(gone, ALL)
    assert np.flatnonzero(~points.static).tolist() == [3]


def test_points_outside_the_overlap_have_no_vote() -> None:
    points, usable = StaticPoints(CENTRES), ALL.copy()
    usable[:4] = False
    outside = np.where(usable[:, None], 0.0, np.nan) * np.ones(2)
    for _ in range(5):
        points.vote(outside, usable)
    assert points.static.all()


def test_points_in_a_line_and_few_points() -> None:
    line = StaticPoints(CENTRES[:4])
    shifts = np.zeros((4, 2))
    shifts[2] = 5.0
    for _ in range(2):
        line.vote(shifts, np.ones(4, bool))
    assert line.static.tolist() == [True, True, False, True]
    few = StaticPoints(CENTRES[:2])
    few.vote(shifts[1:3], np.ones(2, bool))
    assert few.static.all()
