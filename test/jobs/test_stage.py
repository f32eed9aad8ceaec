"""Stages of a pipeline keep the order, hand errors on and end their threads."""

from __future__ import annotations

import threading

import pytest

from stab_ros.core.errors import WorkError
from stab_ros.jobs.stage import Stage


def test_stages_keep_the_order_of_what_is_put() -> None:
    done: list[int] = []

    def double(item: int) -> None:
        last.put(item * 2)

    with Stage(done.append) as last, Stage(double) as first:
        for number in range(200):
            first.put(number)
    assert done == list(range(0, 400, 2))


def test_what_a_later_stage_raises_ends_the_work() -> None:
    done: list[int] = []

    def write(item: int) -> None:
        if item == 5:
            raise WorkError("the disk is full")
        done.append(item)

    def put_all() -> None:
        with Stage(write) as last, Stage(last.put) as first:
            for number in range(1000):
                first.put(number)

    with pytest.raises(WorkError, match="full"):
        put_all()
    assert done[:5] == [0, 1, 2, 3, 4]
    assert len(done) < 20


def test_what_is_raised_for_the_last_item_is_not_lost() -> None:
    def refuse(_: int) -> None:
        raise WorkError("no")

    with pytest.raises(WorkError), Stage(refuse) as stage:
        stage.put(1)


def test_an_error_of_the_one_who_puts_drops_what_is_pending_and_ends_the_thread() -> None:
    gate, done, threads = threading.Event(), list[int](), threading.active_count()

    def work(item: int) -> None:
        gate.wait()
        done.append(item)

    def interrupted() -> None:
        with Stage(work) as stage:
            stage.put(1)
            stage.put(2)
            gate.set()
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert done in ([1], [1, 2])
    assert threading.active_count() == threads
