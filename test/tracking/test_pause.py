"""A start-up that is interrupted before enough was seen: answered provisionally, then continued and decided anew."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache

import numpy as np
import pytest
from flights import SIZE, trap

from stab_ros.core.geometry import rms_distance
from stab_ros.core.types import Frame, Track
from stab_ros.parameters.engines import make_stabilizer
from stab_ros.synthetic.flight import Flight
from stab_ros.tracking.stabilizer import Stabilizer
from stab_ros.tracking.start_buffer import GroundState

FRAMES = 36


@cache
def flight() -> Flight:
    return Flight(trap("kolubara", 1.0), SIZE, FRAMES)


@cache
def frames() -> list[Frame]:
    return [Frame(shot.image, "mono8", shot.stamp_ns) for shot in flight()]


def answered(stabilizer: Stabilizer, pauses: dict[int, bool]) -> Iterator[tuple[int, Track]]:
    """pauses: after how many frames, and whether as far as anyone knows the stream has ended. Each track, and when."""
    for number, frame in enumerate(frames(), 1):
        for track in stabilizer.answers(frame):
            yield number, track
        for track in stabilizer.pause(pauses[number]) if number in pauses else ():
            yield number, track


def error_px(track: Track) -> float:
    assert track.ref_H_cur is not None
    return rms_distance(track.ref_H_cur, flight().ref_H_cur(track.index), SIZE)


def without_pause() -> list[Track]:
    return [track for _, track in answered(make_stabilizer({}), {})]


def test_a_pause_after_the_reference_changes_nothing() -> None:
    stabilizer = make_stabilizer({})
    tracks = [track for _, track in answered(stabilizer, {1: False})]
    assert stabilizer.ground is GroundState.DECIDED
    for one, other in zip(tracks, without_pause(), strict=True):
        assert one.ref_H_cur is not None
        assert other.ref_H_cur is not None
        assert np.array_equal(one.ref_H_cur, other.ref_H_cur)
        assert (one.provisional, one.sigma_px, one.reset_counter) == (False, other.sigma_px, 0)


@pytest.mark.parametrize("at", [3, 6, 17])
def test_what_is_answered_early_owns_its_doubt_and_the_rest_is_right(at: int) -> None:
    stabilizer = make_stabilizer({})
    grounds: list[GroundState] = []
    told = []
    for number, track in answered(stabilizer, {at: False}):
        told.append((number, track))
        grounds.append(stabilizer.ground)
    assert [track.index for _, track in told] == list(range(FRAMES))  # each frame is answered once
    early = [track for number, track in told if number == at]
    assert len(early) == at - 1  # and the reference before
    assert all(track.provisional for track in early)
    assert grounds[at - 1] is GroundState.PROVISIONAL
    assert stabilizer.ground is GroundState.DECIDED
    for track in early:
        assert track.sigma_px is not None
        assert error_px(track) < max(0.1, 3 * track.sigma_px)
    rest, same = [track for number, track in told if number > at], without_pause()[at:]
    assert not any(track.provisional for track in rest)
    for one, other in zip(rest, same, strict=True):
        assert one.ref_H_cur is not None
        assert other.ref_H_cur is not None
        np.testing.assert_allclose(one.ref_H_cur, other.ref_H_cur, rtol=0, atol=2e-4)
    assert max(map(error_px, rest)) < 0.15


def test_a_stream_that_has_ended_is_judged_as_at_the_end_of_a_recording() -> None:
    paused, ended = make_stabilizer({}), make_stabilizer({})
    for frame in frames()[:8]:
        paused.answers(frame)
        ended.answers(frame)
    for one, other in zip(paused.pause(ended=True), ended.finish(), strict=True):
        assert one.ref_H_cur is not None
        assert other.ref_H_cur is not None
        assert np.array_equal(one.ref_H_cur, other.ref_H_cur)
        assert (one.sigma_px, one.provisional, one.index) == (other.sigma_px, True, other.index)
    assert (paused.buffering, ended.buffering) == (True, False)
    assert paused.pause(ended=True) == []


def test_half_of_a_start_is_enough_for_a_stream_that_has_ended() -> None:
    stabilizer = make_stabilizer({})
    tracks = [track for number, track in answered(stabilizer, {20: True}) if number == 20]
    assert len(tracks) == 19
    assert not any(track.provisional for track in tracks)
    assert stabilizer.ground is GroundState.DECIDED
    assert max(map(error_px, tracks)) < 0.15
