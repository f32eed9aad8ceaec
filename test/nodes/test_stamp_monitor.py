"""Irregular header stamps: counted, and described."""

from __future__ import annotations

import pytest

from stab_ros.nodes.stamp_monitor import StampMonitor

SECOND_NS, DAY_NS = 10**9, 86_400 * 10**9


@pytest.mark.parametrize(("stamps", "count", "words"), [
    ([5 * SECOND_NS, 6 * SECOND_NS], {}, ""),
    ([5 * SECOND_NS, 0], {"stamps_zero": "1"}, "a header stamp is zero"),
    ([0, 0], {"stamps_zero": "2"}, "a header stamp is zero"),
    ([5 * SECOND_NS, 0, 3 * SECOND_NS], {"stamps_zero": "1", "stamps_back": "1"}, "went back by 2.000 s"),
    ([SECOND_NS, SECOND_NS + DAY_NS], {"stamps_ahead": "1"}, "jumped ahead by 86400.000 s"),
])
def test_stamps_are_counted_and_described(stamps: list[int], count: dict[str, str], words: str) -> None:
    monitor = StampMonitor()
    steps = [monitor.take(stamp) for stamp in stamps]
    none = dict.fromkeys(("stamps_zero", "stamps_duplicate", "stamps_back", "stamps_ahead"), "0")
    assert monitor.counts == {**none, **count}
    assert words in monitor.words(steps[-1])
    assert bool(words) == bool(monitor.words(steps[-1]))


def test_only_the_stamp_of_the_last_image_is_a_duplicate() -> None:
    monitor = StampMonitor()
    assert not monitor.is_duplicate(0)
    monitor.take(7)
    monitor.take(0)  # no stamp: the next image is compared with the one before
    assert [monitor.is_duplicate(stamp) for stamp in (0, 7, 8)] == [False, True, False]
    assert monitor.counts["stamps_duplicate"] == "1"


@pytest.mark.parametrize(("divisor", "rate", "words"), [
    (1000, 1, "header stamps say 0.04 ms between frames, they are published every 40 ms (factor 1000): perhaps "
              "microseconds in nanosec"),
    (1, 1, ""),
    (1, 10, ""),  # replays
    (1, 0.1, ""),
])
def test_stamps_in_another_unit_are_told_from_a_replay(divisor: int, rate: float, words: str) -> None:
    monitor, step_ns = StampMonitor(), 40_000_000
    said = [monitor.rate_fault(SECOND_NS + number % 25 * step_ns // divisor + number // 25 * SECOND_NS,
                               DAY_NS + round(number * step_ns / rate)) for number in range(60)]
    assert {one for one in said if one} == ({f"{words}; the camera driver must stamp its images with the time in "
                                             "nanoseconds"} if words else set())
