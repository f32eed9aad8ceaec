"""Images that are not what they claim to be: dropped, counted, and named; the next good one is answered."""

from __future__ import annotations

from array import array

import numpy as np
import pytest
from live_graph import Graph, image_message
from rclpy.serialization import serialize_message
from stream import TrackedStream

from stab_ros.synthetic.flight import Shot

NO_DATA = array("B")
# fields that are wrong, and the words that must name them
HOSTILE: dict[str, tuple[dict[str, object], str]] = {
    "more pixels than memory": ({"height": 100_000, "width": 100_000, "data": array("B", bytes(16))}, "width x height"),
    "rows shorter than the picture is wide": ({"step": 1}, "step"),
    "a row that ends within a value": ({"encoding": "mono16", "step": 961, "data": array("B", bytes(961 * 270))},
                                       "step"),
    "more data than rows": ({"height": 200}, "data"),
    "data cut off": ({"data": array("B", bytes(1000))}, "data"),
    "unknown encoding": ({"encoding": "holographic"}, "encoding"),
    "values that are not read": ({"encoding": "64FC1", "step": 3840,
                                  "data": array("B", np.full(480 * 270, np.nan).tobytes())}, "encoding"),
    "no pixels": ({"height": 0, "width": 0, "step": 0, "data": NO_DATA}, "width x height"),
    "one pixel": ({"height": 1, "width": 1, "step": 1, "data": array("B", b"\1")}, "width x height"),
    "one row": ({"height": 1, "width": 65535, "step": 65535, "data": array("B", bytes(65535))}, "width x height"),
}


@pytest.mark.parametrize("queue_depth", [0, 1])
def test_hostile_images_are_dropped_counted_and_named(graph: Graph, flight: list[Shot], queue_depth: int) -> None:
    stream = TrackedStream(graph, queue_depth=queue_depth)
    stream.show(image_message(flight[0].image, 1))
    stream.until_answered(1)
    for number, (wrong, names) in enumerate(HOSTILE.values(), start=1):
        stream.show(image_message(flight[0].image, 1 + number, **wrong))
        message = stream.until_told(frames_refused=number)
        assert "refused an image: " in message
        assert names in message
    stream.show(image_message(flight[1].image, 77))
    stream.until_answered(2)
    assert stream.stamps == [1, 77]
    assert stream.homography(1).any()
    stream.until_told(frames_refused=len(HOSTILE), frames_tracked=2, frames_lost=0, reset_counter=0)


def test_the_log_is_not_flooded(graph: Graph, flight: list[Shot]) -> None:
    stream = TrackedStream(graph)
    stream.show(*[image_message(flight[0].image, number, step=1) for number in range(1, 200)])
    stream.until_told(frames_refused=199)
    assert 1 <= stream.tracker.log.count("refused an image: image step 1 is too small") <= 20


def test_an_encoding_that_is_no_text(graph: Graph, flight: list[Shot]) -> None:
    stream = TrackedStream(graph)
    good = serialize_message(image_message(flight[0].image, 5))
    stream.show(good.replace(b"mono8", b"m\xff\xfe\x80\x81"), good)
    stream.until_answered(1)
    assert stream.stamps == [5]
    stream.until_said("utf-8")
    stream.until_told(frames_refused=1)
