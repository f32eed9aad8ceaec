"""What waits for the evaluator: in order, bounded by its memory, references before the frames they belong to."""

from __future__ import annotations

import numpy as np
from truth import frame

from stab_ros.core.types import Frame
from stab_ros.evaluation.evaluator import Arrival
from stab_ros.nodes.backlog import Backlog

PICTURE = np.zeros((10, 100), np.uint8)  # 1000 bytes
SECOND_NS = 10**9


def arrival(index: int, lost: bool = False) -> Arrival:
    one = frame(PICTURE, index)
    return Arrival(index, one.stamp_ns, None, lost, None if lost else one)


def emptied(backlog: Backlog) -> list[str]:
    """References as R and frames as F, with their number (from the stamp)."""
    found = []
    while backlog:
        item = backlog.pop()
        number = (item.stamp_ns - frame(PICTURE, 0).stamp_ns) // 40_000_000
        found.append(f"{'R' if isinstance(item, Frame) else 'F'}{number}")
    return found


def test_frames_come_out_in_order() -> None:
    backlog = Backlog(10_000)
    assert not backlog
    for index in range(5):
        assert backlog.add(arrival(index), 0) == []
    assert len(backlog) == 5
    assert emptied(backlog) == ["F0", "F1", "F2", "F3", "F4"]


def test_the_oldest_images_are_dropped_when_memory_is_full() -> None:
    backlog, skipped = Backlog(3500), []
    for index in range(6):
        skipped += backlog.add(arrival(index), 0)
    assert [one.index for one in skipped] == [0, 1, 2]
    assert emptied(backlog) == ["F3", "F4", "F5"]
    for index in range(3):
        assert backlog.add(arrival(index), 0) == [], "the memory of dropped and removed frames is free again"


def test_lost_frames_cost_nothing_and_stay() -> None:
    backlog = Backlog(2500)
    for index in range(10):
        assert backlog.add(arrival(index, lost=True), 0) == []
    skipped = [one.index for index in range(10, 14) for one in backlog.add(arrival(index), 0)]
    assert skipped == [10, 11]
    assert emptied(backlog) == [*(f"F{index}" for index in range(10)), "F12", "F13"]


def test_a_single_image_always_has_room() -> None:
    backlog = Backlog(10)
    assert backlog.add(arrival(0), 0) == []
    assert [one.index for one in backlog.add(arrival(1), 0)] == [0]
    assert emptied(backlog) == ["F1"]


def test_it_is_crowded_from_half_on() -> None:
    backlog = Backlog(4000)
    crowded = []
    for index in range(4):
        backlog.add(arrival(index), 0)
        crowded.append(backlog.crowded)
    assert crowded == [False, False, True, True]
    backlog.pop()
    backlog.pop()
    assert not backlog.crowded


def test_the_delay_is_that_of_the_oldest() -> None:
    backlog = Backlog(10_000)
    assert backlog.delay_ns(5 * SECOND_NS) == 0
    backlog.add(arrival(0), 1 * SECOND_NS)
    backlog.add(arrival(1), 3 * SECOND_NS)
    assert backlog.delay_ns(4 * SECOND_NS) == 3 * SECOND_NS
    backlog.pop()
    assert backlog.delay_ns(4 * SECOND_NS) == 1 * SECOND_NS


def test_a_reference_goes_before_its_own_frame() -> None:
    backlog = Backlog(10_000)
    for index in range(3):
        backlog.add(arrival(index), 0)
    backlog.add_reference(frame(PICTURE, 1), 0, at_once=False)
    assert emptied(backlog) == ["F0", "R1", "F1", "F2"]


def test_the_first_reference_of_frames_long_past_goes_before_all() -> None:
    backlog = Backlog(10_000)
    for index in range(7, 9):
        backlog.add(arrival(index), 0)
    backlog.add_reference(frame(PICTURE, 0), 0, at_once=True)
    assert emptied(backlog) == ["R0", "F7", "F8"]


def test_a_reference_of_a_frame_to_come_waits_for_it() -> None:
    backlog = Backlog(10_000)
    backlog.add(arrival(7), 0)
    backlog.add_reference(frame(PICTURE, 8), 0, at_once=False)
    backlog.add(arrival(8), 0)
    assert emptied(backlog) == ["F7", "R8", "F8"]
