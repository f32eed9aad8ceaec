"""Free time runs only while a node has nothing to do."""

from __future__ import annotations

from stab_ros.nodes.free_time import FreeTime


def test_time_is_free_only_while_nothing_is_to_be_done() -> None:
    free = FreeTime()
    free.waited(3, 10)
    free.waited(5_000, 10)  # the process was stopped, or got no CPU
    free.waited(-1, 10)
    assert free.ns == 13


def test_timers_stand_for_waits_where_nobody_tells_of_any() -> None:
    free = FreeTime()
    free.ticked(100)
    assert free.ns == 100
    free.waited(7, 10)
    free.ticked(100)
    assert free.ns == 107
