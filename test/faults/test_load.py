"""Frames that are dropped, late or come all at once, and subscribers that do not keep up."""

from __future__ import annotations

import signal
import time

import pytest
from live_graph import Graph, image_message
from rclpy.qos import QoSProfile
from sensor_msgs.msg import Image
from stream import TrackedStream

from stab_ros.synthetic.flight import Shot

MS = 10**6
BURST = 200


@pytest.mark.parametrize("queue_depth", [0, 1])
def test_a_burst_of_200_frames(graph: Graph, flight: list[Shot], queue_depth: int) -> None:
    """Kept, every frame is answered; else the newest one soon, and what was passed over is counted."""
    stream = TrackedStream(graph, queue_depth=queue_depth, qos=300 if queue_depth == 0 else 1)
    stream.show(image_message(flight[0].image, 1))
    stream.until_answered(1)
    begin_s, last = time.monotonic(), BURST + 1
    for number in range(2, last + 1):
        stream.show(image_message(flight[number % 10].image, number))
    sent_s = time.monotonic() - begin_s
    graph.until(lambda: stream.stamps[-1] == last, "the newest frame answered")
    print(f"sent in {sent_s:.2f} s, the newest answered {time.monotonic() - begin_s - sent_s:.2f} s later, "
          f"{last - len(stream.answers)} passed over")
    assert sent_s < 10, "the publisher was blocked"
    graph.until(lambda: stream.told and int(stream.told["frames_in"]) + int(stream.told["frames_dropped"]) == last,
                "all counted")
    assert int(stream.told["frames_in"]) == len(stream.answers)
    if queue_depth == 0:
        assert len(stream.answers) == last
    else:
        assert len(stream.answers) < last


def test_dropped_late_and_repeated_frames(graph: Graph, flight: list[Shot]) -> None:
    """As a bad radio link delivers them; nothing that comes stays without an answer."""
    stream = TrackedStream(graph)
    order = [0, 1, 3, 2, 2, 6, 7, 5, 9, 9]  # 4 and 8 never come
    for k in order:
        stream.show(image_message(flight[k].image, k * 40 * MS + 1))
    stream.until_answered(8)
    assert stream.stamps == [k * 40 * MS + 1 for k in (0, 1, 3, 2, 6, 7, 5, 9)]
    stream.until_told(frames_tracked=8, frames_lost=0, stamps_duplicate=2, stamps_back=2)
    assert all(stream.homography(k).any() for k in range(8))


def test_a_subscriber_that_stands_still_holds_nobody_up(graph: Graph, flight: list[Shot]) -> None:
    """An evaluator that is stopped, RELIABLE, of pictures and homographies; the tracker does not wait for it."""
    evaluator = graph.start("evaluator_node")
    stream = TrackedStream(graph, queue_depth=1, wait_for_subscribers=2, qos=QoSProfile(depth=1))
    stream.show(image_message(flight[0].image, 1))
    stream.until_answered(1)
    evaluator.process.send_signal(signal.SIGSTOP)
    late_s = []
    for number in range(2, 302):
        begin_s = time.monotonic()
        stream.show(image_message(flight[number % 10].image, number))
        stream.until_answered(number)
        late_s.append(time.monotonic() - begin_s)
    evaluator.process.send_signal(signal.SIGCONT)
    print(f"an answer took {1e3 * sorted(late_s)[len(late_s) // 2]:.0f} ms, at most {1e3 * max(late_s):.0f} ms")
    assert max(late_s) < 5, "the tracker waited for the subscriber"
    stream.until_told(frames_tracked=301, frames_dropped=0)
    watching = graph.listen(Image, "/image_stabilized", 1)
    graph.until(lambda: graph.node.count_publishers("/image_stabilized"), "discovery")

    def seen() -> bool:
        stream.show(image_message(flight[1].image, 1000 + len(stream.answers)))
        return bool(watching)

    graph.until(seen, "pictures for others")
