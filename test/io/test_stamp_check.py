"""Header stamps that are wrong, and those that only look odd: each stream as cameras and recorders make them."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np
import pytest

from stab_ros.io.stamp_check import StampCheck

STEP_NS = 41_666_667
START_NS = 1_700_000_000_123_456_789
Stamp = Callable[[int], int]


def taken(count: int = 60) -> list[int]:
    """When the images were taken, ns."""
    return [START_NS + number * STEP_NS for number in range(count)]


def fault(stamps_ns: Iterable[int], logged_ns: Iterable[int], published_ns: Iterable[int] | None = None) -> str:
    check, logged = StampCheck(), list(logged_ns)
    for stamp_ns, publish_ns, log_ns in zip(stamps_ns, published_ns or logged, logged, strict=True):
        check.add(stamp_ns, publish_ns, log_ns)
    return check.fault()


def in_bursts(times_ns: list[int], size: int) -> list[int]:
    """Messages that are held until `size` of them go out, 0.1 ms apart."""
    last = len(times_ns) - 1
    return [times_ns[min(k // size * size + size - 1, last)] + k % size * 100_000 for k in range(len(times_ns))]


WRONG: dict[str, tuple[Stamp, str]] = {
    "microseconds": (lambda t: t // 10**9 * 10**9 + t % 10**9 // 1000,
                     "say 0.0417 ms between frames, the log 41.7 ms (factor 1000): perhaps microseconds in nanosec"),
    "milliseconds": (lambda t: t // 10**9 * 10**9 + t % 10**9 // 10**6, "(factor 1000000): perhaps milliseconds in"),
    "whole seconds": (lambda t: t // 10**9 * 10**9, "say 0 ms between frames, the log 41.7 ms: they are whole seconds"),
    "tenths": (lambda t: t // 10**8 * 10**8, "most repeat the one before"),
    "zero": (lambda _: 0, "60 of 60 header stamps are zero"),
    "two in three zero": (lambda t: t * (t // STEP_NS % 3 == 0), "40 of 60 header stamps are zero"),
    "one zero": (lambda t: t * (t != START_NS + 3 * STEP_NS), "1 of 60 header stamps is zero"),
    "one zero, others back by an hour": (
        lambda t: (t - 3600 * 10**9 * (t > START_NS + 10**9)) * (t > START_NS),
        "1 of 60 header stamps is zero and header stamps go back once, by 3599.96 s"),
    "back by half a second": (lambda t: t - 5 * 10**8 * (t > START_NS + 10**9), "go back once, by 0.458333 s"),
    "a quarter as fast": (lambda t: t // 4, "(factor 4)"),
    "five times as fast": (lambda t: START_NS + 5 * (t - START_NS), "say 208 ms between frames, the log 41.7 ms"),
    "back by an hour": (lambda t: t - 3600 * 10**9 * (t > START_NS + 10**9), "go back once, by 3599.96 s"),
    "into another epoch": (lambda t: t % 10**15 + 10**18 * (t > START_NS + 10**9), "jump ahead of the log once"),
}


@pytest.mark.parametrize("name", WRONG)
def test_wrong_stamps_are_named(name: str) -> None:
    stamp, words = WRONG[name]
    assert words in fault(map(stamp, taken()), taken())


@pytest.mark.parametrize("name", WRONG)
def test_wrong_stamps_are_named_where_publish_times_are_even_and_the_log_is_not(name: str) -> None:
    if name not in {"microseconds", "milliseconds", "whole seconds", "tenths", "a quarter as fast"}:  # as its bursts
        stamp, words = WRONG[name]
        assert words.split(":")[0].split(",")[0] in fault(map(stamp, taken()), in_bursts(taken(), 3), taken())


FINE: dict[str, Stamp] = {
    "equal": lambda t: t,
    "a clock that is hours apart": lambda t: t - 7_200 * 10**9,
    "time since boot": lambda t: t - START_NS + 10**9,
    "a clock that drifts": lambda t: t + (t - START_NS) // 1000,
    "a slow simulation, or a slow replay": lambda t: START_NS + (t - START_NS) // 2,
    "a delay that grows": lambda t: t - (t - START_NS) // 10,
}


@pytest.mark.parametrize("name", FINE)
@pytest.mark.parametrize("burst", [1, 2, 7, 30])
def test_no_alarm(name: str, burst: int) -> None:
    assert not fault(map(FINE[name], taken()), in_bursts(taken(), burst))


def test_no_alarm_for_streams_with_gaps() -> None:
    rng = np.random.default_rng(0)
    dropped = [t for t in taken(200) if rng.random() > 0.7]
    paused = [t + 100 * 10**9 * (k > 30) for k, t in enumerate(taken())]
    lapse = [START_NS // 10**9 * 10**9 + number * 60 * 10**9 for number in range(60)]  # one a minute, in whole seconds
    for times_ns in (dropped, paused, lapse):
        assert not fault(times_ns, times_ns)
        assert not fault(times_ns, in_bursts(times_ns, 3))


def test_no_alarm_where_the_log_has_no_times() -> None:
    """As after a conversion, which logs everything at once."""
    assert not fault(taken(), [START_NS] * 60)
    assert not fault(taken(), [START_NS + number * 100_000 for number in range(60)])
    assert not fault([], [])
    assert not fault(taken(1), taken(1))
