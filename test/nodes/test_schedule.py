"""When the player publishes a message: faster, slower, and after a stall."""

from __future__ import annotations

from stab_ros.nodes.schedule import Schedule

SECOND_NS = 10**9


def test_schedule_plays_faster_and_slower() -> None:
    fast = Schedule(bag_start_ns=100 * SECOND_NS, start_ns=7 * SECOND_NS, rate=4.0)
    assert fast.due_ns(108 * SECOND_NS) == 9 * SECOND_NS
    assert fast.bag_time_ns(9 * SECOND_NS) == 108 * SECOND_NS
    assert Schedule(0, 0, 0.5).due_ns(SECOND_NS) == 2 * SECOND_NS


def test_schedule_goes_on_after_a_stall() -> None:
    stalled = Schedule(0, 0, 2.0).resumed(5 * SECOND_NS)
    assert stalled.due_ns(4 * SECOND_NS) == 7 * SECOND_NS
    assert stalled.bag_time_ns(7 * SECOND_NS) == 4 * SECOND_NS
