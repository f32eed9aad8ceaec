"""Lost messages, counted by the gaps in their sequence numbers."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from stab_ros.nodes.gap_counter import GapCounter


@given(st.lists(st.integers(1, 5), min_size=1))
def test_gaps_add_up(steps: list[int]) -> None:
    counter = GapCounter()
    numbers = np.cumsum(steps).tolist()
    missed = sum(counter.missed(number) for number in numbers)
    assert missed == numbers[-1] - numbers[0] + 1 - len(numbers)


def test_gaps_of_another_publisher_are_not_counted() -> None:
    counter = GapCounter()
    assert [counter.missed(number) for number in (1000, 1002, 1, 2, 5)] == [0, 1, 0, 0, 2]
    assert counter.missed(99, publishers=2) == 0


def test_what_comes_while_suspended_is_not_missed() -> None:
    gaps = GapCounter()
    assert [gaps.missed(number) for number in (5, 7)] == [0, 1]
    gaps.suspend()
    assert [gaps.missed(number) for number in (100, 102)] == [0, 1]
    assert gaps.before == 4
