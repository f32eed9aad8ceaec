"""Pairs by stamp, in the order of the first topic, whatever the order of arrival."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from stab_ros.nodes.stamp_pairing import Pair, StampPairing


def told(pairs: list[Pair[str, str]]) -> list[tuple[int, str, str | None]]:
    return [(pair.stamp_ns, pair.question, pair.answer) for pair in pairs]


@given(st.data())
def test_each_pair_is_found_however_one_topic_lags(data: st.DataObject) -> None:
    """Some messages of either topic are missing; the rest comes in order, interleaved at random."""
    stamps = range(1, data.draw(st.integers(1, 20)))
    asked = [stamp for stamp in stamps if data.draw(st.booleans())]
    answered = [stamp for stamp in stamps if data.draw(st.booleans())]
    turns = data.draw(st.permutations([True] * len(asked) + [False] * len(answered)))
    pairing: StampPairing[str, str] = StampPairing(1000)
    found, questions, answers = list[Pair[str, str]](), iter(asked), iter(answered)
    for is_question in turns:
        stamp = next(questions if is_question else answers)
        found += pairing.ask(stamp, f"q{stamp}") if is_question else pairing.answer(stamp, f"a{stamp}")
    found += pairing.flush()
    assert told(found) == [(stamp, f"q{stamp}", f"a{stamp}" if stamp in answered else None) for stamp in asked]
    assert len(pairing) == 0


def test_pair_ends_the_wait_of_those_before_it() -> None:
    pairing: StampPairing[str, str] = StampPairing(1000)
    assert [*pairing.ask(1, "a"), *pairing.ask(2, "b"), *pairing.ask(3, "c")] == []
    assert told(pairing.answer(2, "B")) == [(1, "a", None), (2, "b", "B")]
    assert pairing.answer(1, "A") == []  # too late
    assert told(pairing.answer(3, "C")) == [(3, "c", "C")]


def test_recording_that_begins_again_is_paired_again() -> None:
    pairing: StampPairing[str, str] = StampPairing(1000)
    for _ in range(3):
        pairing.ask(8, "x")
        pairing.ask(9, "y")
        assert told(pairing.answer(8, "X")) == [(8, "x", "X")]
        assert told(pairing.answer(9, "Y")) == [(9, "y", "Y")]


def test_oldest_questions_give_way_beyond_the_limit() -> None:
    pairing: StampPairing[str, str] = StampPairing(5, len)
    assert told(pairing.ask(1, "aaa") + pairing.ask(2, "bb") + pairing.ask(3, "c")) == [(1, "aaa", None)]
    assert told(pairing.ask(4, "much too long")) == [(2, "bb", None), (3, "c", None)]
    assert len(pairing) == 1


def test_answers_that_nobody_asks_for_are_forgotten() -> None:
    pairing: StampPairing[str, str] = StampPairing(10)
    for stamp in range(5000):
        assert pairing.answer(stamp, "x") == []
    assert told(pairing.ask(4999, "q")) == [(4999, "q", "x")]
    assert pairing.ask(3, "q") == []
