"""A camera that changes its size or bit depth in flight: a new reference, counted and said with the reason."""

from __future__ import annotations

from array import array

import cv2
import numpy as np
import pytest
from live_graph import Graph, image_message
from stream import TrackedStream

from stab_ros.core.types import Gray
from stab_ros.synthetic.flight import Shot

MS = 10**6


def coloured(gray: Gray, stamp_ns: int) -> object:
    bgr = cv2.cvtColor(gray, cv2.COLOR_GRAY2BGR)
    width = gray.shape[1]
    return image_message(gray, stamp_ns, encoding="bgr8", step=3 * width, data=array("B", bgr.tobytes()))


def deep(gray: Gray, stamp_ns: int) -> object:
    data = array("B", (gray.astype(np.uint16) * 257).tobytes())
    return image_message(gray, stamp_ns, encoding="mono16", step=2 * gray.shape[1], data=data)


def smaller(gray: Gray, stamp_ns: int) -> object:
    return image_message(np.ascontiguousarray(gray[20:220, 30:400]), stamp_ns)


@pytest.mark.parametrize(("other", "why"), [(deep, "another bit depth, 480x270 mono16"),
                                            (smaller, "another size, 370x200 mono8")])
@pytest.mark.parametrize("start_s", [0.0, 1.0])  # at once, and in the middle of a start
def test_another_size_or_bit_depth_is_a_new_reference(
    graph: Graph, flight: list[Shot], other: object, why: str, start_s: float
) -> None:
    assert callable(other)
    stream = TrackedStream(graph, start_s=start_s, stale_s=2.0)
    for k in range(9):
        make = other if 3 <= k < 6 else image_message
        stream.show(make(flight[k].image, (1 + k) * 40 * MS))
    stream.until_answered(9)
    assert stream.stamps == [(1 + k) * 40 * MS for k in range(9)]
    anew = [bool(np.array_equal(stream.homography(k), np.eye(3))) for k in range(9)]
    assert anew == [k in (0, 3, 6) for k in range(9)]
    stream.until_told(reset_counter=2, frames_tracked=9)
    log = stream.tracker.log
    assert f"homographies begin anew at stamp {4 * 40 * MS} ns: the images have {why}; reset_counter is 1" in log
    assert log.count(f"the images have {why}") == 1


def test_grey_and_coloured_images_by_turns_are_one_camera(graph: Graph, flight: list[Shot]) -> None:
    stream = TrackedStream(graph, start_s=0.0, stale_s=2.0)
    for k in range(6):
        stream.show((coloured if k % 2 else image_message)(flight[k].image, (1 + k) * 40 * MS))
    stream.until_answered(6)
    assert [bool(np.array_equal(stream.homography(k), np.eye(3))) for k in range(6)] == [k == 0 for k in range(6)]
    stream.until_told(reset_counter=0, frames_tracked=6)


def test_one_strange_image_is_not_the_end_of_the_reference(graph: Graph, flight: list[Shot]) -> None:
    """A flat or tiny one in between, as drivers send when they start."""
    stream = TrackedStream(graph)
    stream.show(image_message(flight[0].image, 1), image_message(np.zeros((100, 100), np.uint8), 2),
                image_message(np.zeros((8, 8), np.uint8), 3), image_message(flight[1].image, 4))
    stream.until_answered(3)
    assert stream.stamps == [1, 2, 4]
    assert not stream.homography(1).any()
    stream.until_told(reset_counter=0, frames_lost=1, frames_refused=1, frames_tracked=2)
