"""Pictures and homographies, in whatever order they come, are given out once each, in the order of the stream."""

from __future__ import annotations

from itertools import chain

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from truth import frame

from stab_ros.core.types import Frame
from stab_ros.evaluation.evaluator import Arrival
from stab_ros.evaluation.pairing import Pairing

EYE = np.eye(3)


def picture(index: int) -> Frame:
    return frame(np.full((4, 4), index, np.uint8), index)


STAMPS = [picture(index).stamp_ns for index in range(60)]


def pairing_of(expect_homography: bool, pictures: int = 100) -> Pairing:
    """One in which so many pictures may wait."""
    return Pairing(expect_homography, pictures * picture(0).image.nbytes)


def told(arrivals: list[Arrival]) -> list[tuple[int, bool, bool, bool]]:
    """Index, lost, with picture, with homography."""
    return [(one.index, one.lost, one.frame is not None, one.ref_H_cur is not None) for one in arrivals]


def test_a_pair_is_given_out_whichever_half_comes_first() -> None:
    pairing = pairing_of(True)
    assert pairing.homography(STAMPS[0], EYE) == []
    assert told(pairing.image(picture(0))) == [(0, False, True, True)]
    assert pairing.image(picture(1)) == []
    assert told(pairing.homography(STAMPS[1], EYE)) == [(1, False, True, True)]


def test_a_lost_frame_needs_no_picture_and_its_held_one_is_ignored() -> None:
    pairing = pairing_of(True)
    assert told(pairing.homography(STAMPS[0], None)) == [(0, True, False, False)]
    assert pairing.image(picture(0)) == []
    assert pairing.flush() == []


def test_a_lost_frame_waits_for_the_pictures_before_it() -> None:
    pairing = pairing_of(True)
    assert pairing.homography(STAMPS[0], EYE) == []
    assert pairing.homography(STAMPS[1], None) == []
    assert told(pairing.image(picture(0))) == [(0, False, True, True), (1, True, False, False)]


def test_a_picture_that_is_missing_holds_nothing_up() -> None:
    pairing = pairing_of(True)
    for index in range(3):
        assert pairing.homography(STAMPS[index], EYE) == []
    assert told(pairing.image(picture(2))) == [(0, False, False, True), (1, False, False, True), (2, False, True, True)]
    assert [pairing.homography(STAMPS[index], EYE if index == 3 else None) for index in range(3, 6)] == [[], [], []]
    assert (pairing.homographies_waiting, pairing.pictures_waiting) == (3, 0)
    assert told(pairing.flush()) == [(3, False, False, True), (4, True, False, False), (5, True, False, False)]


def test_a_homography_that_is_missing_holds_nothing_up() -> None:
    pairing = pairing_of(True)
    for index in range(3):
        assert pairing.image(picture(index)) == []
    assert (pairing.homographies_waiting, pairing.pictures_waiting) == (0, 3)
    assert told(pairing.homography(STAMPS[2], EYE)) == [
        (0, False, True, False), (1, False, True, False), (2, False, True, True)]


def test_without_homographies_pictures_pass_at_once() -> None:
    pairing = pairing_of(False)
    assert [told(pairing.image(picture(index))) for index in range(3)] == [
        [(index, False, True, False)] for index in range(3)]
    assert pairing.homography(STAMPS[1], EYE) == [], "too late for a picture that has been given out"
    assert pairing.flush() == []


def test_pictures_wait_for_their_homographies_as_long_as_there_is_room() -> None:
    pairing = pairing_of(True, pictures=8)
    given_out = [pairing.image(picture(index)) for index in range(20)]
    assert told([*chain(*given_out)]) == [(index, False, True, False) for index in range(12)]
    assert pairing.homography(STAMPS[5], EYE) == [], "too late"
    assert told(pairing.homography(STAMPS[12], EYE)) == [(12, False, True, True)]
    assert told(pairing.flush()) == [(index, False, True, False) for index in range(13, 20)]


def test_a_recording_that_starts_again_is_measured_again() -> None:
    pairing = pairing_of(True)
    for round_ in range(2):
        for index in range(5):
            first, second = (pairing.homography(STAMPS[index], EYE), pairing.image(picture(index))) if index else (
                pairing.image(picture(index)), pairing.homography(STAMPS[index], EYE))
            assert told([*first, *second]) == [(5 * round_ + index, False, True, True)]


@given(st.data())
def test_every_order_gives_the_stream(data: st.DataObject) -> None:
    """Each topic is in order by itself; one lags behind the other by any number of frames."""
    lost = data.draw(st.sets(st.integers(0, 29)))
    order = data.draw(st.permutations([True] * 30 + [False] * 30))
    pairing, given_out = pairing_of(True), list[Arrival]()
    homographies, pictures = iter(range(30)), iter(range(30))
    for is_homography in order:
        index = next(homographies if is_homography else pictures)
        if is_homography:
            given_out += pairing.homography(STAMPS[index], None if index in lost else EYE)
        elif index not in lost:
            given_out += pairing.image(picture(index))
    given_out += pairing.flush()
    assert told(given_out) == [(i, i in lost, i not in lost, i not in lost) for i in range(30)]
