"""A camera's clock that is set back is told from messages that were overtaken; the first is said, the second sorted."""

from __future__ import annotations

import random
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.writer import Writer

from stab_ros.io.bag_types import Message, definition_of
from stab_ros.io.cdr import Header, read_stamp
from stab_ros.io.image_message import image_cdr
from stab_ros.io.source import open_source
from stab_ros.io.stamp_order import StampOrder
from stab_ros.jobs.info import describe

TOPIC, IMAGE = "/cam/image_raw", "sensor_msgs/msg/Image"
START_NS, STEP_NS, DELAY_NS = 1_700_000_000 * 10**9, 40_000_000, 3_000_000
FRAMES = 30


def data_of(stamp_ns: int, grey: int = 0) -> bytes:
    return image_cdr(np.full((2, 2), grey, np.uint8), "mono8", Header(stamp_ns))


def logged(stamps_ns: Sequence[int], logged_ns: Sequence[int] | None = None) -> list[Message]:
    """logged_ns: None: as even as a camera's."""
    times_ns = logged_ns or [START_NS + number * STEP_NS + DELAY_NS for number in range(len(stamps_ns))]
    return [Message(TOPIC, time_ns, time_ns, data_of(stamp_ns, number))
            for number, (stamp_ns, time_ns) in enumerate(zip(stamps_ns, times_ns, strict=True))]


def written(messages: Sequence[Message], path: Path) -> Path:
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start(profile="ros2")
        schema = writer.register_schema(IMAGE, "ros2msg", definition_of(IMAGE).encode())
        channel = writer.register_channel(TOPIC, "cdr", schema)
        for message in messages:
            writer.add_message(channel, message.log_time_ns, message.data, message.publish_time_ns)
        writer.finish()
    return path


def read(bag: Path) -> tuple[list[int], list[str]]:
    """The stamps of the pictures as they are taken, and the warnings."""
    with open_source(bag, None) as source:
        return [picture.stamp_ns for picture in source.frames()], source.warnings


def back(at: int, by_s: float, frames: int = FRAMES) -> list[int]:
    """Stamps of a clock that is set back before image `at`."""
    return [START_NS + number * STEP_NS - round(by_s * 1e9) * (number >= at) for number in range(frames)]


def in_order(messages: Sequence[Message]) -> tuple[list[Message], int]:
    order = StampOrder([TOPIC])
    return list(order.sorted(messages)), order.late[TOPIC]


@pytest.mark.parametrize("by_s", [0.11, 0.2, 0.33, 0.5, 0.9, 0.99, 1.0, 1.01, 5.0])
def test_a_clock_that_was_set_back_is_said_and_its_pictures_are_not_mixed(by_s: float, tmp_path: Path) -> None:
    stamps_ns = back(10, by_s)
    bag = written(logged(stamps_ns), tmp_path / "a.mcap")
    found_ns, (warning,) = read(bag)
    assert found_ns == stamps_ns
    said = f"header stamps go back once, by {by_s - 0.04:.6g} s"
    assert warning == (f"{bag}: {TOPIC}: {said}; all that depends on time goes by the header stamps, "
                       "give --time log to go by the log")
    assert [line for line in describe(bag)[1] if said in line]


@settings(deadline=None)
@given(st.integers(2, FRAMES - 2), st.floats(0.1, 3.0), st.integers(0, 2**32))
def test_a_clock_may_be_set_back_anywhere(at: int, by_s: float, seed: int) -> None:
    rng = random.Random(seed)
    uneven_ns = [START_NS + number * STEP_NS + rng.randint(0, STEP_NS // 2) for number in range(FRAMES)]
    messages = logged(back(at, by_s), uneven_ns)
    assert in_order(messages) == (messages, 0)


@settings(deadline=None)
@given(st.integers(0, 2**32), st.integers(1, 4), st.integers(1, 40))
def test_what_was_overtaken_is_sorted_whatever_the_log_says(seed: int, most: int, burst: int) -> None:
    rng, count = random.Random(seed), 60
    shuffled = sorted(range(count), key=lambda number: number + rng.uniform(-most, most))
    stamps_ns = [START_NS + number * STEP_NS for number in shuffled]
    bursts_ns = [START_NS + (number // burst + 1) * burst * STEP_NS + number for number in range(count)]
    for logged_ns in (None, bursts_ns, [START_NS] * count):
        done, late = in_order(logged(stamps_ns, logged_ns))
        assert [message.data[4:12] for message in done] == [data_of(stamp_ns)[4:12] for stamp_ns in sorted(stamps_ns)]
        assert (late == 0) == (shuffled == sorted(shuffled))


@pytest.mark.parametrize("order", [
    [1, 0, 2, 3, 4, 5], [0, 1, 2, 3, 5, 4], [0, 1, 2, 3, 7, 4, 5, 6], [*range(8), *range(16, 24), *range(8, 16), 24],
    [1, 2, 3, 4, 5, 6, 7, 0, 8, 9], [number ^ 1 for number in range(FRAMES)]])
def test_overtaken_pictures_are_said_with_the_way_out(order: list[int], tmp_path: Path) -> None:
    stamps_ns = [START_NS + number * STEP_NS for number in order]
    found_ns, (warning,) = read(written(logged(stamps_ns), tmp_path / "a.mcap"))
    assert found_ns == sorted(stamps_ns)
    assert "logged out of order, all are taken in the order of their header stamps, give --time log to go by" in warning
    assert not describe(tmp_path / "a.mcap")[1]


def test_a_clock_that_was_set_back_without_log_times_is_not_mixed() -> None:
    messages = logged(back(15, 0.5), [START_NS] * FRAMES)
    assert in_order(messages) == (messages, 0)


def test_a_picture_that_was_recorded_twice_is_not_a_clock() -> None:
    stamps_ns = [START_NS + number * STEP_NS for number in (0, 1, 2, 3, 4, 5, 3, *range(6, 20))]
    done, late = in_order(logged(stamps_ns))
    assert late == 1
    assert [message.data[4:12] for message in done] == [data_of(stamp_ns)[4:12] for stamp_ns in sorted(stamps_ns)]


@pytest.mark.parametrize(("stamps_ns", "is_sorted"), [
    (back(10, 0.5, 16), False), (back(10, 0.2, 16), False), ([START_NS + (k ^ 1) * STEP_NS for k in range(16)], True)])
def test_pictures_of_which_few_can_be_held(stamps_ns: list[int], is_sorted: bool) -> None:
    padding = bytes(23_000_000)  # 4K in colour
    made = (message._replace(data=message.data + padding) for message in logged(stamps_ns))
    found_ns = [read_stamp(message.data) for message in StampOrder([TOPIC]).sorted(made)]
    assert found_ns == (sorted(stamps_ns) if is_sorted else stamps_ns)


@pytest.mark.parametrize("by_s", [0.2, 0.5])
def test_a_clock_that_was_set_back_beside_another_stream(by_s: float) -> None:
    """Both of 4K in colour; two pictures of the other one come between the first after it and the next."""
    other, padding = "/other/image_raw", bytes(24_900_000)
    stamps_ns, running_ns = back(10, by_s, 15), back(15, 0, 15)
    pairs = [((TOPIC, stamps_ns[k]), (other, running_ns[k])) for k in range(15)]
    sent = [one for k, pair in enumerate(pairs) for one in (reversed(pair) if k == 11 else pair)]
    made = (Message(topic, START_NS + number * STEP_NS // 2, 0, data_of(stamp_ns) + padding)
            for number, (topic, stamp_ns) in enumerate(sent))
    order = StampOrder([TOPIC, other])
    assert [(message.topic, read_stamp(message.data)) for message in order.sorted(made)] == sent
    assert not any(order.late.values())


@pytest.mark.parametrize("zero", [(1, 3, 5, 7, 9), (0, 1, 2), (11,)])
def test_some_stamps_of_zero_are_said(zero: Sequence[int], tmp_path: Path) -> None:
    stamps_ns = [(START_NS + number * STEP_NS) * (number not in zero) for number in range(12)]
    bag = written(logged(stamps_ns), tmp_path / "a.mcap")
    found_ns, (warning,) = read(bag)
    assert found_ns == stamps_ns
    assert f"{len(zero)} of 12 header stamps {'is' if len(zero) == 1 else 'are'} zero; all that depends on" in warning
    assert "give --time log" in warning
    assert "header stamps" in describe(bag)[1][0]
