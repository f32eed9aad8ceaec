"""Which verification points count as static after several frames."""

from __future__ import annotations

import numpy as np
from truth import similarity, translation

from stab_ros.core.geometry import apply
from stab_ros.metrics.static_points import StaticPoints

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
