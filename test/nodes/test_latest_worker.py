"""Work in a thread of its own: who gives it never waits, and the newest item wins."""

from __future__ import annotations

from contextlib import nullcontext
from threading import Event, Thread

import pytest
import rclpy.logging

from stab_ros.core.errors import InputError
from stab_ros.nodes.failures import Failures
from stab_ros.nodes.latest_worker import LatestWorker


class Slow:
    """Work that takes until it is let go on."""

    def __init__(self) -> None:
        self.begun, self.go_on, self.done = Event(), Event(), list[int]()

    def __call__(self, item: int) -> None:
        self.begun.set()
        assert self.go_on.wait(60)
        self.done.append(item)


def test_the_newest_item_wins_and_nobody_waits_for_slow_work() -> None:
    slow = Slow()
    worker = LatestWorker(slow, nullcontext())
    worker.put(1)
    assert slow.begun.wait(60)
    for item in range(2, 100):
        worker.put(item)
    assert slow.done == []
    slow.go_on.set()
    worker.flush()
    assert slow.done == [1, 99]
    worker.close()


def test_nothing_is_lost_where_all_is_kept() -> None:
    slow = Slow()
    worker = LatestWorker(slow, nullcontext(), keep_all=True)

    def give() -> None:
        for item in range(5):
            worker.put(item)

    giver = Thread(target=give)
    giver.start()
    assert slow.begun.wait(60)
    slow.go_on.set()
    giver.join(60)
    worker.flush()
    assert slow.done == [0, 1, 2, 3, 4]
    worker.close()


def test_an_error_is_noted_and_the_next_item_worked_on() -> None:
    failures, done = Failures(rclpy.logging.get_logger("test")), list[float]()

    def invert(item: int) -> None:
        done.append(1 / item)

    worker = LatestWorker(invert, failures)
    for item in (0, 2):
        worker.put(item)
        worker.flush()
    worker.close()
    assert (failures.count, done) == (1, [0.5])


def test_who_gives_nothing_starts_no_thread_and_can_close() -> None:
    worker = LatestWorker(list[int]().append, nullcontext())
    worker.flush()
    worker.close()


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_nobody_waits_for_a_thread_that_an_error_has_ended() -> None:
    def fails(item: int) -> None:
        raise InputError(f"{item} is no picture")

    worker = LatestWorker(fails, Failures(rclpy.logging.get_logger("test")), keep_all=True)
    for item in range(3):
        worker.put(item)
    worker.flush()
    worker.close()
