"""What the tracker makes of the images and cameras it meets, as a separate process over DDS."""

from __future__ import annotations

import signal
import threading
import time
from pathlib import Path

import cv2
import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from live_graph import Graph, image_message, stamp_ns, values_of
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import CameraInfo, CompressedImage, Image
from truth import picture

from stab_ros.core.geometry import shift
from stab_ros.io.cdr import Header
from stab_ros.io.image_message import image_cdr
from stab_ros.synthetic.flight import Shot

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
BEST_EFFORT = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)


def test_newest_frame_wins_and_drops_are_counted(graph: Graph, flight: list[Shot]) -> None:
    tracker = graph.start("tracker_node", queue_depth=1, start_s=0.0, stale_s=60.0, wait_for_subscribers=1)
    diagnostics = graph.listen(DiagnosticArray, "/diagnostics", 1)
    answers = graph.listen(CameraInfo, "/homography")
    camera = graph.speak(Image, "/image_raw", 1)
    camera.publish(image_message(flight[0].image, 0))
    graph.until(lambda: answers, "the first answer")
    tracker.process.send_signal(signal.SIGSTOP)  # the slowest consumer there is
    for number in range(1, 50):
        camera.publish(image_message(flight[0].image, number))
    tracker.process.send_signal(signal.SIGCONT)
    graph.until(lambda: stamp_ns(answers[-1]) == 49, "the newest frame answered")
    graph.until(lambda: diagnostics and values_of(diagnostics[-1])["frames_in"] == str(len(answers)), "the report")
    values = values_of(diagnostics[-1])
    assert int(values["frames_in"]) + int(values["frames_dropped"]) == 50
    assert int(values["frames_dropped"]) > 0
    assert values["state"] == "TRACKED"
    assert float(values["latency_ms"]) > 0


@pytest.mark.thorough
def test_a_tracker_that_is_too_slow_stays_current(graph: Graph) -> None:
    """4K on one thread, by a method that takes several frames' time for one."""
    tracker = graph.start("tracker_node", method="klt", start_s=0.0, stale_s=60.0, threads=1,
                          wait_for_subscribers=1)
    diagnostics = graph.listen(DiagnosticArray, "/diagnostics", 1)
    come, used_mb = dict[int, float](), list[float]()

    def on_answer(answer: CameraInfo) -> None:
        come[stamp_ns(answer) - 1] = time.monotonic()
        used_mb.append(anonymous_mb(tracker.process.pid))

    graph.node.create_subscription(CameraInfo, "/homography", on_answer, 100)
    camera = graph.speak(Image, "/image_raw", 1)
    images = [np.kron(picture(shift(0.5 * k, 0.0), (1024, 540)), np.ones((4, 4), np.uint8)) for k in range(3)]
    messages = [image_cdr(images[number % 3], "mono8", Header(number)) for number in range(151)]
    sent_s = list[float]()

    def send() -> None:
        for message in messages:
            sent_s.append(time.monotonic())
            camera.publish(message)
            time.sleep(max(0.0, sent_s[0] + len(sent_s) / 30 - time.monotonic()))

    camera.publish(messages.pop(0))  # what came before the first that is taken, nobody can count
    graph.until(lambda: come, "the first answer")
    come.clear()
    sending = threading.Thread(target=send)
    sending.start()
    graph.until(lambda: len(messages) - 1 in come, "the newest frame answered")
    sending.join()
    graph.until(lambda: diagnostics and values_of(diagnostics[-1])["frames_in"] == str(len(come) + 1), "the report")
    dropped = int(values_of(diagnostics[-1])["frames_dropped"])
    assert len(come) + dropped == len(messages)
    assert dropped > len(messages) / 4  # it is too slow
    late_s = [come_s - sent_s[number] for number, come_s in come.items()]
    longest_s = max(np.diff(list(come.values())))
    assert max(late_s) < 3 * longest_s  # one in work, one waiting: a queue would add an interval for each place
    assert used_mb[-1] < used_mb[len(used_mb) // 2] + 20


def anonymous_mb(pid: int) -> float:
    """RssAnon of a process."""
    return int(Path(f"/proc/{pid}/status").read_text(encoding="utf-8").partition("RssAnon:")[2].split()[0]) / 1024


@pytest.mark.parametrize("depth", [8, 16])
def test_compressed_images_stay_grey(graph: Graph, flight: list[Shot], depth: int) -> None:
    sent = flight[0].image if depth == 8 else flight[0].image.astype(np.uint16) * 257
    graph.start("tracker_node", "/cam", image_transport="compressed", queue_depth=0, wait_for_subscribers=1)
    answers = graph.listen(CameraInfo, "/cam/homography")
    images = graph.listen(Image, "/cam/image_stabilized")
    camera = graph.speak(CompressedImage, "/cam/image_raw/compressed")
    graph.until(lambda: graph.node.count_publishers("/cam/image_stabilized"), "discovery")
    message = CompressedImage(format="png", data=cv2.imencode(".png", sent)[1].tobytes())
    camera.publish(message)
    graph.until(lambda: answers and images, "the answer")
    assert images[0].encoding == f"mono{depth}"
    assert bytes(images[0].data) == sent.tobytes()


def test_images_that_come_another_way_are_named(graph: Graph) -> None:
    tracker = graph.start("tracker_node", "/cam")
    graph.node.create_publisher(CompressedImage, "/cam/image_raw/compressed", 1)
    graph.until(lambda: "nobody publishes /cam/image_raw, but /cam/image_raw/compressed is published; set "
                        "image_transport:=compressed" in tracker.log, "the hint")
    graph.node.create_publisher(CompressedImage, "/cam/image_raw", 1)
    graph.until(lambda: "/cam/image_raw: a publisher sends sensor_msgs/msg/CompressedImage, nothing is received from "
                        "it; it must be sensor_msgs/msg/Image" in tracker.log, "the type")
