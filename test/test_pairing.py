"""Pictures and homographies, in whatever order they come, are given out once each, in the order of the stream."""

from __future__ import annotations

from itertools import chain

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from truth import frame

from stab_ros.core.evaluation import Arrival
from stab_ros.core.types import Frame
from stab_ros.io.pairing import Pairing

EYE = np.eye(3)


def picture(index: int) -> Frame:
    return frame(np.full((4, 4), index, np.uint8), index)


STAMPS = [picture(index).stamp_ns for index in range(60)]


def told(arrivals: list[Arrival]) -> list[tuple[int, bool, bool, bool]]:
    """Index, lost, with picture, with homography."""
    return [(one.index, one.lost, one.frame is not None, one.ref_H_cur is not None) for one in arrivals]


def test_a_pair_is_given_out_whichever_half_comes_first() -> None:
    pairing = Pairing(expect_homography=True)
    assert pairing.homography(STAMPS[0], EYE) == []
    assert told(pairing.image(picture(0))) == [(0, False, True, True)]
    assert pairing.image(picture(1)) == []
    assert told(pairing.homography(STAMPS[1], EYE)) == [(1, False, True, True)]


def test_a_lost_frame_needs_no_picture_and_its_held_one_is_ignored() -> None:
    pairing = Pairing(expect_homography=True)
    assert told(pairing.homography(STAMPS[0], None)) == [(0, True, False, False)]
    assert pairing.image(picture(0)) == []
    assert pairing.flush() == []


def test_a_lost_frame_waits_for_the_pictures_before_it() -> None:
    pairing = Pairing(expect_homography=True)
    assert pairing.homography(STAMPS[0], EYE) == []
    assert pairing.homography(STAMPS[1], None) == []
    assert told(pairing.image(picture(0))) == [(0, False, True, True), (1, True, False, False)]


def test_a_picture_that_is_missing_holds_nothing_up() -> None:
    pairing = Pairing(expect_homography=True)
    for index in range(3):
        assert pairing.homography(STAMPS[index], EYE) == []
    assert told(pairing.image(picture(2))) == [(0, False, False, True), (1, False, False, True), (2, False, True, True)]
    lost = [pairing.homography(STAMPS[index], EYE if index == 3 else None) for index in range(3, 20)]
    assert told(list(chain(*lost))) == [(3, False, False, True), *((i, True, False, False) for i in range(4, 20))]


def test_without_homographies_pictures_pass_at_once() -> None:
    pairing = Pairing(expect_homography=False)
    assert [told(pairing.image(picture(index))) for index in range(3)] == [
        [(index, False, True, False)] for index in range(3)]
    assert pairing.homography(STAMPS[1], EYE) == [], "too late for a picture that has been given out"
    assert pairing.flush() == []


def test_a_picture_whose_homography_never_comes_is_given_out_without() -> None:
    pairing = Pairing(expect_homography=True)
    given_out = [pairing.image(picture(index)) for index in range(20)]
    assert told([*chain(*given_out), *pairing.flush()]) == [(index, False, True, False) for index in range(20)]


def test_a_recording_that_starts_again_is_measured_again() -> None:
    pairing = Pairing(expect_homography=True)
    for round_ in range(2):
        for index in range(5):
            pairing.homography(STAMPS[index], EYE)
            assert told(pairing.image(picture(index))) == [(5 * round_ + index, False, True, True)]


@given(st.data())
def test_every_order_with_little_delay_gives_the_stream(data: st.DataObject) -> None:
    """Each topic is in order by itself; one lags behind the other by up to 7 frames."""
    lost = data.draw(st.sets(st.integers(0, 29)))
    pairing = Pairing(expect_homography=True)
    given_out: list[Arrival] = []
    homographies, pictures = 0, 0
    while homographies < 30 or pictures < 30:
        ahead = homographies - pictures
        may, must = ahead < 7 and homographies < 30, ahead <= -7 or pictures == 30
        if must or (may and data.draw(st.booleans())):
            given_out += pairing.homography(STAMPS[homographies], None if homographies in lost else EYE)
            homographies += 1
        else:
            given_out += [] if pictures in lost else pairing.image(picture(pictures))
            pictures += 1
    given_out += pairing.flush()
    assert told(given_out) == [(i, i in lost, i not in lost, i not in lost) for i in range(30)]
