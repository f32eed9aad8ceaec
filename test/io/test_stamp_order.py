"""Messages that were logged out of order come in the order of their stamps; everything else as it was logged."""

from __future__ import annotations

import random
from collections.abc import Iterator

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from stab_ros.io.bag_types import Message
from stab_ros.io.cdr import Header
from stab_ros.io.image_message import image_cdr
from stab_ros.io.stamp_order import StampOrder

STEP_NS, START_NS = 40_000_000, 10**9


def image(number: int, topic: str = "/images") -> Message:
    """number: of the frame, which its stamp tells; the log time has nothing to do with it."""
    return Message(topic, 0, 0, image_cdr(np.zeros((2, 2), np.uint8), "mono8", Header(START_NS + number * STEP_NS)))


def other(number: int) -> Message:
    return Message("/others", number, 0, b"")


def through(messages: list[Message], *topics: str) -> tuple[list[Message], int]:
    order = StampOrder(topics or ["/images"])
    return list(order.sorted(messages)), sum(order.late.values())


@given(st.integers(0, 2**32), st.integers(1, 4))
def test_neighbours_are_sorted_and_others_keep_their_order(seed: int, most: int) -> None:
    rng, count = random.Random(seed), 40
    shuffled = sorted(range(count), key=lambda number: number + rng.uniform(-most, most))
    logged = [one for number in shuffled for one in (image(number), other(number))]
    done, late = through(logged)
    assert [one for one in done if one.topic == "/images"] == [image(number) for number in range(count)]
    assert [one for one in done if one.topic == "/others"] == [other(number) for number in shuffled]
    assert (late == 0) == (shuffled == sorted(shuffled))


def test_what_is_in_order_passes_as_it_was_logged() -> None:
    logged = [one for number in range(30) for one in (other(number), image(number), image(number // 2, "/more"))]
    assert through(logged, "/images", "/more") == (logged, 0)


def test_a_recording_that_starts_again_is_not_mixed() -> None:
    logged = [image(number) for number in (*range(50), *range(50))]
    assert through(logged) == (logged, 0)


def test_what_has_no_stamp_stays_in_place() -> None:
    zero = Message("/images", 0, 0, image(0).data[:4] + bytes(40))
    logged = [image(0), Message("/images", 0, 0, b""), image(2), zero]
    assert through(logged) == (logged, 0)


def test_topics_are_sorted_each_by_itself() -> None:
    late = [image(number, topic) for number in (1, 2, 3, 4, 5, 6, 7, 0, 8, 9) for topic in ("/images", "/more")]
    done, count = through(late, "/images", "/more")
    assert count == 2
    for topic in ("/images", "/more"):
        assert [one for one in done if one.topic == topic] == [image(number, topic) for number in range(10)]


def test_what_lies_between_rare_images_is_not_held_for_ever() -> None:
    order, held, most = StampOrder(["/images"]), 0, 0
    size = 2**21

    def logged() -> Iterator[Message]:
        nonlocal held, most
        for number in range(400):
            held += 1
            most = max(most, held)
            yield Message("/others", number, 0, bytes(size)) if number % 100 else image(number)

    for _ in order.sorted(logged()):
        held -= 1
    assert most < 2**26 / size + 3
