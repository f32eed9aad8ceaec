"""How long frames wait for a topic that may be silent."""

from __future__ import annotations

from stab_ros.nodes.patience import Patience


def test_is_over_once_a_frame_has_waited_long_enough() -> None:
    patience = Patience(5)
    assert [patience.check(now, True) for now in (0, 5, 6, 7)] == [False, False, True, True]


def test_silence_counts_only_while_something_waits() -> None:
    patience = Patience(5)
    patience.heard(0)
    assert not patience.check(100, False)
    assert [patience.check(now, True) for now in (101, 106, 107)] == [False, False, True]


def test_each_message_is_worth_another_wait() -> None:
    patience = Patience(5)
    patience.check(0, True)
    patience.heard(4)
    assert [patience.check(now, True) for now in (9, 10)] == [False, True]
    assert patience.check(11, False)  # the next frame does not wait
    patience.heard(12)
    assert not patience.check(13, True)
