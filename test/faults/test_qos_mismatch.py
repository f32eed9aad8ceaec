"""Quality of service that does not match, either way: adapted to, or an ERROR that names topic, policy and fix."""

from __future__ import annotations

import pytest
from live_graph import Graph, image_message
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import CameraInfo, Image
from stream import TrackedStream

from stab_ros.synthetic.flight import Shot

BEST_EFFORT = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


def errors(log: str) -> list[str]:
    return [line for line in log.splitlines() if "ERROR" in line]


def test_a_best_effort_camera(graph: Graph, flight: list[Shot]) -> None:
    """The newest frame is taken from whoever offers it; to keep all frames, the camera must be RELIABLE."""
    newest = graph.start("tracker_node", "/newest", remap={"image_raw": "/image_raw"})
    keeping = graph.start("tracker_node", "/keeping", remap={"image_raw": "/image_raw"}, queue_depth=0)
    answers = graph.listen(CameraInfo, "/newest/homography")
    graph.until(lambda: all("ready" in one.log for one in (newest, keeping)), "both ready")
    camera = graph.speak(Image, "/image_raw", BEST_EFFORT)
    sent = 0

    def answered() -> bool:  # the tracker may still be subscribing anew
        nonlocal sent
        sent += 1
        camera.publish(image_message(flight[0].image, sent))
        return bool(answers)

    graph.until(answered, "an answer")
    graph.until(lambda: errors(keeping.log), "the error")
    (line,) = errors(keeping.log)
    assert "/image_raw: a publisher offers an incompatible RELIABILITY" in line
    assert "let it offer RELIABLE, or set queue_depth:=1" in line
    assert not errors(newest.log)


def test_a_camera_that_becomes_reliable_again_is_kept(graph: Graph, flight: list[Shot]) -> None:
    stream = TrackedStream(graph, queue_depth=1, qos=BEST_EFFORT)
    graph.node.destroy_publisher(stream.camera)
    stream.camera = graph.speak(Image, "/image_raw", QoSProfile(depth=1))
    sent = 0

    def answered() -> bool:
        nonlocal sent
        sent += 1
        stream.show(image_message(flight[0].image, sent))
        return bool(stream.answers)

    graph.until(answered, "an answer")
    offered = graph.node.get_subscriptions_info_by_topic("/image_raw")
    graph.until(lambda: graph.node.get_subscriptions_info_by_topic("/image_raw")[0].qos_profile.reliability
                == ReliabilityPolicy.RELIABLE, f"a RELIABLE subscription, not {offered[0].qos_profile.reliability}")


@pytest.mark.parametrize(("topic", "msg_class"), [("/homography", CameraInfo), ("/image_stabilized", Image)])
def test_a_subscriber_that_asks_for_more_than_is_offered(graph: Graph, topic: str, msg_class: type) -> None:
    """Latched homographies there are none."""
    tracker = graph.start("tracker_node")
    graph.until(lambda: "ready" in tracker.log, "the tracker")
    graph.listen(msg_class, topic, LATCHED)
    graph.until(lambda: errors(tracker.log), "the error")
    (line,) = errors(tracker.log)
    assert f"{topic}: a subscriber asks for a DURABILITY that is not offered and gets nothing" in line
    assert "let it subscribe with durability VOLATILE" in line


def test_a_recorder_takes_what_it_is_offered(graph: Graph, tmp_path: object) -> None:
    recorder = graph.start("bag_recorder_node", output=f"{tmp_path}/out.mcap", topics=["/image_raw"])
    camera = graph.speak(Image, "/image_raw", BEST_EFFORT)
    assert not errors(recorder.log)
    second = graph.node.create_publisher(Image, "/image_raw", QoSProfile(depth=1))
    graph.until(second.get_subscription_count, "both publishers recorded")
    assert camera.get_subscription_count() == 1
    assert recorder.stop() == 0
    assert not errors(recorder.log)
