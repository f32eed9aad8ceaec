"""/tf of the georeference node, with tf2_msgs as installed, or made here by rosidl where it is not; and without."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from geometry_msgs.msg import TwistWithCovarianceStamped
from georeferenced_stream import NODE, GeoreferencedStream, by_the_engine, motion, shot
from live_graph import Graph, image_message, stamp_ns
from message_package import ROS, compiler, install_messages, sourced
from rosbags.highlevel import AnyReader

MOVING = {"orientation": "dynamic_stabilization", "height_m": 30.0}
TF_PACKAGE = {"TFMessage": "geometry_msgs/TransformStamped[] transforms\n"}


def test_motion_is_that_of_the_engine_and_there_is_none_across_lost_frames(graph: Graph) -> None:
    heard = graph.listen(TwistWithCovarianceStamped, f"{NODE}/motion")
    stream = GeoreferencedStream(graph, MOVING, image=False)
    told = [None if number == 3 else motion(number) for number in range(7)]
    for number, one in enumerate(told):
        stream.show(shot(number))
        stream.tell(shot(number).stamp_ns, one)
    stream.until_answered(7)
    graph.until(lambda: len(heard) == 4, "every motion")
    engine = by_the_engine(MOVING)
    twists = {shot(number).stamp_ns: engine.frame(shot(number), one).twist for number, one in enumerate(told)}
    assert [stamp_ns(one) for one in heard] == [shot(number).stamp_ns for number in (1, 2, 5, 6)]
    for one in heard:
        wanted, linear, angular = twists[stamp_ns(one)], one.twist.twist.linear, one.twist.twist.angular
        assert wanted is not None
        np.testing.assert_allclose([linear.x, linear.y, linear.z], wanted.linear_m_s, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose([angular.x, angular.y, angular.z], wanted.angular_rad_s, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(np.reshape(one.twist.covariance, (6, 6)), wanted.covariance, rtol=1e-5, atol=1e-9)
        assert one.header.frame_id == "cam"


@pytest.mark.skipif((ROS / "share/tf2_msgs").is_dir(), reason="tf2_msgs is installed")
def test_without_tf2_msgs_it_is_said_and_all_else_works(graph: Graph) -> None:
    stream = GeoreferencedStream(graph, {**MOVING, "publish_tf": True}, image=False)
    stream.show(shot(0))
    stream.tell(shot(0).stamp_ns, motion(0))
    assert stream.until_answered(1)[0]["state"] == "PLACED"
    assert stream.node.log.count("publish_tf has no effect: message type tf2_msgs/msg/TFMessage is not installed") == 1


@pytest.mark.thorough
def test_transforms_are_those_of_the_poses(graph: Graph, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As our recorder writes them and rosbags reads them. An image without frame_id is said, once."""
    if not (ROS / "share/tf2_msgs").is_dir():
        found = compiler()
        if found is None:
            pytest.skip("no compiler of C and C++, or no headers of Python")
        monkeypatch.setenv("AMENT_PREFIX_PATH", str(ROS))
        made = install_messages(tmp_path / "install", "tf2_msgs", TF_PACKAGE, found, ("geometry_msgs",))
        graph.environment = sourced(graph.environment, made)
    output = tmp_path / "tf.mcap"
    topics = ["/tf", f"{NODE}/pose", "/cam/ortho_info"]
    recorder = graph.run("stab-ros", ["record", str(output), *topics], ("-m", "stab_ros"))
    settings = {**MOVING, "publish_tf": True, "wait_for_subscribers": 2}  # of ortho_info: this one and the recorder
    stream = GeoreferencedStream(graph, settings, image=False)
    stream.until_reported(topics=len(topics))
    for number in range(6):
        message = image_message(shot(number).image, shot(number).stamp_ns)
        message.header.frame_id = "" if number in (2, 3) else "cam"
        stream.publish(message)
        stream.tell(shot(number).stamp_ns, motion(number))
    stream.until_answered(6)
    assert (stream.node.stop(), recorder.stop()) == (0, 0)
    assert stream.node.log.count("the images have no frame_id, so that their camera is not on /tf") == 1
    with AnyReader([output]) as bag:
        read: list[tuple[str, Any]] = [(one.topic, bag.deserialize(data, one.msgtype))
                                       for one, _, data in bag.messages()]
    poses = {stamp_ns(one): one.pose.pose for topic, one in read if topic == f"{NODE}/pose"}
    sent = [one for topic, message in read if topic == "/tf" for one in message.transforms]
    assert [stamp_ns(one) for one in sent] == [shot(number).stamp_ns for number in (0, 1, 4, 5)]
    for one in sent:
        pose = poses[stamp_ns(one)]
        assert (one.header.frame_id, one.child_frame_id) == ("map", "cam")
        place, turn = one.transform.translation, one.transform.rotation
        assert (place.x, place.y, place.z) == (pose.position.x, pose.position.y, pose.position.z)
        q = pose.orientation
        assert (turn.x, turn.y, turn.z, turn.w) == (q.x, q.y, q.z, q.w)
