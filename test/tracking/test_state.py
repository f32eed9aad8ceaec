"""The state machine of the tracker: its table, and that a real stream goes through it."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from truth import flat, frame, picture, random_noise, translation

from stab_ros.parameters.engines import make_stabilizer
from stab_ros.tracking.state import TRANSITIONS, Event, TrackerState, next_state

WAITING, STARTING, TRACKED, LOST = TrackerState


def test_every_state_can_be_reached_and_left() -> None:
    assert set(TRANSITIONS) == set(TrackerState)
    reached = {WAITING}
    for _ in TrackerState:
        reached |= {after for state in reached for after in TRANSITIONS[state].values()}
    assert reached == set(TrackerState)
    assert all(set(TRANSITIONS[state].values()) - {state} for state in TrackerState)


def test_a_reset_waits_and_a_reference_tracks_whatever_was_before() -> None:
    for state in TrackerState:
        assert next_state(state, Event.RESET) is WAITING
        assert next_state(state, Event.REFERENCE) is TRACKED


@pytest.mark.parametrize(("state", "event"), [
    pair for pair in itertools.product(TrackerState, Event) if pair[1] not in TRANSITIONS[pair[0]]
])
def test_what_cannot_happen_is_refused(state: TrackerState, event: Event) -> None:
    with pytest.raises(ValueError, match=f"{event.name} cannot happen while {state.name}"):
        next_state(state, event)


def test_a_stream_goes_through_all_states() -> None:
    stabilizer = make_stabilizer({"start_s": 0.2})
    seen = [stabilizer.state]
    images = [flat(), *(picture(translation(0.3 * number, 0.1)) for number in range(8)), random_noise(1),
              picture(translation(1, 1))]
    for number, image in enumerate(images):
        stabilizer.answers(frame(image, number))
        seen.append(stabilizer.state)
    stabilizer.reset_reference()
    seen.append(stabilizer.state)
    assert [state for state, _ in itertools.groupby(seen)] == [WAITING, STARTING, TRACKED, LOST, TRACKED, WAITING]


def test_frames_buffered_before_a_reset_are_answered_and_bring_no_reference_back() -> None:
    stabilizer = make_stabilizer({})
    for number in range(4):
        stabilizer.answers(frame(picture(translation(0.3 * number, 0.0)), number))
    assert stabilizer.state is STARTING
    stabilizer.reset_reference()
    late = stabilizer.finish()
    assert [track.index for track in late] == [1, 2, 3]
    assert all(track.ref_H_cur is not None and np.isfinite(track.ref_H_cur).all() for track in late)
    assert stabilizer.state is WAITING
    assert stabilizer.reference is None
