"""When a stream counts as stale, and when its silence is a pause."""

from __future__ import annotations

from stab_ros.nodes.stream_timeout import StreamTimeout

SECOND_NS = 10**9


def test_silence_of_a_stream() -> None:
    timeout = StreamTimeout(stale_ns=2 * SECOND_NS)
    assert not timeout.has_begun
    assert timeout.silence_ns(9 * SECOND_NS) == 0  # there is none before the first image
    assert not timeout.is_stale(9 * SECOND_NS)
    assert timeout.on_image(9 * SECOND_NS) == 0
    assert (timeout.is_stale(11 * SECOND_NS), timeout.is_stale(11 * SECOND_NS + 1)) == (False, True)
    assert (timeout.is_pause(19 * SECOND_NS), timeout.is_pause(19 * SECOND_NS + 1)) == (False, True)


def test_a_slow_stream_is_given_more_time() -> None:
    timeout = StreamTimeout(stale_ns=2 * SECOND_NS)
    for at_s in (0, 26, 52):
        timeout.on_image(at_s * SECOND_NS)
    assert not timeout.is_pause((52 + 78) * SECOND_NS)
    assert timeout.is_pause((52 + 78) * SECOND_NS + 1)
    timeout.on_image(53 * SECOND_NS)  # as quick as others again
    assert timeout.is_pause((53 + 10) * SECOND_NS + 1)
