"""A node that may sleep while nobody listens."""

from __future__ import annotations

from stab_ros.nodes.sleep import Sleep


def looked(sleep: Sleep, subscribers: int, times: int, busy: bool = False) -> bool:
    for _ in range(times):
        sleep.look(subscribers, busy)
    return sleep.is_asleep


def test_it_sleeps_from_its_start_until_somebody_listens() -> None:
    sleep = Sleep(allowed=True)
    assert sleep.is_asleep
    assert looked(sleep, 0, 1)
    assert not looked(sleep, 1, 1)


def test_it_stays_awake_for_a_second_without_a_listener() -> None:
    sleep = Sleep(allowed=True)
    assert not looked(sleep, 1, 1)
    assert not looked(sleep, 0, 9)
    assert looked(sleep, 0, 1)


def test_it_ends_first_what_it_is_busy_with() -> None:
    sleep = Sleep(allowed=True)
    assert not looked(sleep, 1, 1)
    assert not looked(sleep, 0, 50, busy=True)
    assert looked(sleep, 0, 1)
    assert looked(sleep, 0, 1, busy=True)  # it takes no images by which it could be ended


def test_it_is_settled_a_second_later() -> None:
    """As somebody who has started with it may not be seen at once."""
    sleep = Sleep(allowed=True)
    assert looked(sleep, 0, 9)
    assert not sleep.is_settled
    assert looked(sleep, 0, 1)
    assert sleep.is_settled
    assert not looked(sleep, 1, 1)
    assert not sleep.is_settled


def test_it_never_sleeps_where_it_may_not() -> None:
    assert not looked(Sleep(allowed=False), 0, 100)
