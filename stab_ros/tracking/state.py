"""The states of the tracker and the events that change them, in one table."""

from __future__ import annotations

from collections.abc import Mapping
from enum import Enum
from types import MappingProxyType


class TrackerState(Enum):
    """WAITING: no reference yet. STARTING: frames are buffered. TRACKED, LOST: as the last frame."""

    WAITING = "waiting"
    STARTING = "starting"
    TRACKED = "tracked"
    LOST = "lost"


class Event(Enum):
    """What happens to the tracker.

    REFERENCE: a frame became the reference. BUFFERED: the frames after it are buffered. DECIDED: the start-up is over.
    ACCEPTED, REJECTED: the registration of a frame. RESET: the user wants another reference.
    """

    REFERENCE = "reference"
    BUFFERED = "buffered"
    DECIDED = "decided"
    ACCEPTED = "accepted"
    REJECTED = "rejected"
    RESET = "reset"


_WAITING, _STARTING, _TRACKED, _LOST = TrackerState
_ANYWHERE = {Event.REFERENCE: _TRACKED, Event.RESET: _WAITING}

# An event that a state does not list cannot happen in it.
TRANSITIONS: Mapping[TrackerState, Mapping[Event, TrackerState]] = MappingProxyType({
    # frames that were buffered before a reset are answered late: they bring no reference back
    _WAITING: {**_ANYWHERE, Event.ACCEPTED: _WAITING, Event.REJECTED: _WAITING, Event.DECIDED: _WAITING},
    # frames that are answered within the start-up do not end it
    _STARTING: {**_ANYWHERE, Event.ACCEPTED: _STARTING, Event.REJECTED: _STARTING, Event.DECIDED: _TRACKED},
    _TRACKED: {**_ANYWHERE, Event.ACCEPTED: _TRACKED, Event.REJECTED: _LOST, Event.BUFFERED: _STARTING},
    _LOST: {**_ANYWHERE, Event.ACCEPTED: _TRACKED, Event.REJECTED: _LOST},
})


def next_state(state: TrackerState, event: Event) -> TrackerState:
    """The state after an event.

    Raises:
        ValueError: the event cannot happen in this state.
    """
    after = TRANSITIONS[state].get(event)
    if after is None:
        raise ValueError(f"{event.name} cannot happen while {state.name}")
    return after
