"""Player and recorder as users run them: separate processes over DDS, real bags, real faults."""

from __future__ import annotations

import os
import resource
import shutil
from collections import defaultdict
from pathlib import Path
from typing import Any

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import Point, Pose, PoseStamped
from live_graph import Graph, image_message, stamp_ns, values_of
from mcap.reader import make_reader
from nav_msgs.msg import Goals
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message, serialize_message
from rclpy.time import Time
from recordings import FRAME_ID, IMAGE_TOPIC, OTHER_TOPIC
from rosbags.highlevel import AnyReader
from rosbags.interfaces import ConnectionExtRosbag2
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import CameraInfo, Image
from std_msgs.msg import Float64, Header, String

from stab_ros.io.bag import BagWriter, Topic, topic_of
from stab_ros.io.installed_types import python_folders
from stab_ros.synthetic.flight import Shot

STRING = "std_msgs/msg/String"
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
KEEP_ALL = QoSProfile(history=HistoryPolicy.KEEP_ALL)
BEST_EFFORT = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)


def write_strings(path: Path, count: int, period_ns: int = 10_000_000, qos: str = "") -> Path:
    """`count` messages "0", "1", ... on /said."""
    with BagWriter(path) as writer:
        writer.add_topic(topic_of("/said", STRING, qos))
        for number in range(count):
            time_ns = 10**9 + number * period_ns
            writer.write("/said", time_ns, time_ns, serialize_message(String(data=str(number))))
    return path


def offers(reliability: str, durability: str = "volatile") -> str:
    forever = "{sec: 9223372036, nsec: 854775807}"
    return (f"- history: unknown\n  depth: 0\n  reliability: {reliability}\n  durability: {durability}\n"
            f"  deadline: {forever}\n  lifespan: {forever}\n  liveliness: automatic\n"
            f"  liveliness_lease_duration: {forever}\n  avoid_ros_namespace_conventions: false\n")


def test_player_loses_nothing_though_the_subscriber_is_slow(graph: Graph, tmp_path: Path) -> None:
    bag = write_strings(tmp_path / "bag.mcap", 500)
    heard = graph.listen(String, "/said", KEEP_ALL)
    player = graph.start("bag_player_node", bag=str(bag), rate=1e6, wait_for_subscribers=1)
    graph.until(lambda: len(heard) == 1, "the first message")  # and no other is taken until the player has ended
    assert player.wait() == 0
    graph.until(lambda: len(heard) == 500, "all messages")
    assert [one.data for one in heard] == [str(number) for number in range(500)]


def test_player_offers_what_was_recorded(graph: Graph, tmp_path: Path) -> None:
    bag = tmp_path / "bag.mcap"
    kinds = {"/latched": offers("reliable", "transient_local"), "/sensor": offers("best_effort"), "/unknown": ""}
    with BagWriter(bag) as writer:
        for name, qos in kinds.items():
            writer.add_topic(topic_of(name, STRING, qos))
            writer.write(name, 10**9, 10**9, serialize_message(String(data=name)))
    graph.start("bag_player_node", bag=str(bag), wait_for_subscribers=1000)
    graph.until(lambda: all(graph.node.count_publishers(name) for name in kinds), "three publishers")
    offered = {name: graph.node.get_publishers_info_by_topic(name)[0].qos_profile for name in kinds}
    assert offered["/latched"].durability == DurabilityPolicy.TRANSIENT_LOCAL
    assert {name: one.reliability for name, one in offered.items()} == {
        "/latched": ReliabilityPolicy.RELIABLE, "/sensor": ReliabilityPolicy.BEST_EFFORT,
        "/unknown": ReliabilityPolicy.RELIABLE}


def test_player_waits_for_subscribers_of_images(graph: Graph, recordings: dict[str, Path]) -> None:
    heights = graph.listen(Float64, OTHER_TOPIC)
    player = graph.start("bag_player_node", bag=str(recordings["mcap"]), wait_for_subscribers=1, rate=1e6)
    graph.until(lambda: graph.node.count_publishers(OTHER_TOPIC), "the player")
    assert not heights
    images = graph.listen(Image, IMAGE_TOPIC)
    graph.until(lambda: len(images) == 10, "all images")
    assert player.wait() == 0
    assert [one.header.frame_id for one in images] == [FRAME_ID] * 10


def test_player_loops_from_its_offset_and_tells_the_time(graph: Graph, tmp_path: Path) -> None:
    bag = write_strings(tmp_path / "bag.mcap", 10, period_ns=100_000_000)
    heard = graph.listen(String, "/said", KEEP_ALL)
    clock = graph.listen(Clock, "/clock", KEEP_ALL)
    player = graph.start("bag_player_node", bag=str(bag), loop=True, clock=True, start_offset=0.5, rate=20.0,
                         wait_for_subscribers=1)
    graph.until(lambda: len(heard) >= 13, "three rounds")
    assert player.stop() == 0
    assert [int(one.data) for one in heard[:13]] == [5, 6, 7, 8, 9, 5, 6, 7, 8, 9, 5, 6, 7]
    told_ns = [one.clock.sec * 10**9 + one.clock.nanosec for one in clock]
    assert all(1_500_000_000 <= time_ns <= 1_900_000_000 for time_ns in told_ns)
    assert 1_900_000_000 in told_ns


def test_a_replay_from_later_on_begins_with_what_was_latched(graph: Graph, tmp_path: Path) -> None:
    bag = tmp_path / "bag.mcap"
    with BagWriter(bag) as writer:
        writer.add_topic(topic_of("/map", STRING, offers("reliable", "transient_local")))
        writer.add_topic(topic_of("/said", STRING))
        for name, data, time_ns in (("/map", "old", 10**9), ("/map", "new", 11 * 10**8), ("/said", "early", 12 * 10**8),
                                    ("/said", "late", 2 * 10**9)):
            writer.write(name, time_ns, time_ns, serialize_message(String(data=data)))
    said, latched = graph.listen(String, "/said", KEEP_ALL), graph.listen(String, "/map", KEEP_ALL)
    player = graph.start("bag_player_node", bag=str(bag), start_offset=0.5, wait_for_subscribers=2)
    graph.until(lambda: said and len(latched) == 2, "the messages")
    assert player.wait() == 0
    assert ([one.data for one in said], [one.data for one in latched]) == (["late"], ["old", "new"])


@pytest.mark.parametrize("clock", [True, False])
def test_there_is_one_clock_though_the_bag_holds_another(clock: bool, graph: Graph, tmp_path: Path) -> None:
    bag, recorded_ns = tmp_path / "bag.mcap", 77 * 10**9
    told = Clock(clock=Time(nanoseconds=recorded_ns).to_msg())
    with BagWriter(bag) as writer:
        writer.add_topic(topic_of("/clock", "rosgraph_msgs/msg/Clock"))
        writer.add_topic(topic_of("/said", STRING))
        for number in range(5):
            time_ns = 10**9 + number * 10_000_000
            writer.write("/clock", time_ns, time_ns, serialize_message(told))
            writer.write("/said", time_ns, time_ns, serialize_message(String(data=str(number))))
    heard, times = graph.listen(String, "/said", KEEP_ALL), graph.listen(Clock, "/clock", KEEP_ALL)
    player = graph.start("bag_player_node", bag=str(bag), clock=clock, wait_for_subscribers=2 - clock, rate=0.5)
    graph.until(lambda: len(heard) == 5 and times, "all messages")
    assert player.wait() == 0
    told_ns = {one.clock.sec * 10**9 + one.clock.nanosec for one in times}
    assert (recorded_ns in told_ns) == (not clock)
    assert (told_ns == {recorded_ns}) == (not clock)
    assert ("/clock of the recording is left out" in player.log) == clock


@pytest.mark.thorough
def test_player_leaves_out_what_it_has_no_type_for(graph: Graph, tmp_path: Path) -> None:
    bag = tmp_path / "bag.mcap"
    with BagWriter(bag) as writer:
        writer.add_topic(topic_of("/said", STRING))
        writer.add_topic(Topic("/odd", "nobody_msgs/msg/Odd", 0, "int32 odd"))
        writer.add_topic(topic_of("/odd name", STRING))
        writer.write("/odd", 10**9, 10**9, bytes(8))
        writer.write("/odd name", 10**9, 10**9, serialize_message(String(data="odd")))
        writer.write("/said", 10**9, 10**9, serialize_message(String(data="even")))
    heard = graph.listen(String, "/said")
    player = graph.start("bag_player_node", bag=str(bag), wait_for_subscribers=1)
    graph.until(lambda: heard, "the other topic")
    assert player.wait() == 0
    assert "/odd is left out: message type nobody_msgs/msg/Odd is not installed" in player.log
    assert "/odd name is left out: '/odd name' is no name of a topic, it must be as /camera/image_raw" in player.log


def test_recording_is_read_by_other_libraries(graph: Graph, tmp_path: Path) -> None:
    output = tmp_path / "out.mcap"
    latched = graph.node.create_publisher(String, "/latched", LATCHED)
    latched.publish(String(data="before the recorder came"))
    recorder = graph.start("bag_recorder_node", output=str(output), topics=["/latched", "/sensor", "/said"])
    sensor = graph.speak(Image, "/sensor", BEST_EFFORT)
    said = graph.speak(String, "/said")
    for number in range(50):
        said.publish(String(data=str(number)))
    reports = graph.listen(DiagnosticArray, "/diagnostics", 1)

    def all_there() -> bool:  # what is best effort may be lost
        sensor.publish(Image(encoding="mono8", data=[1, 2, 3], height=1, width=3, step=3))
        return bool(reports) and int(values_of(reports[-1])["messages"]) > 51

    graph.until(all_there, "all messages")
    assert recorder.stop() == 0

    with output.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        assert reader.get_header().profile == "ros2"
        recorded = list(reader.iter_messages())
        strings = {topic: [deserialize_message(message.data, String).data
                           for _, channel, message in recorded if channel.topic == topic]
                   for topic in ("/latched", "/said")}
        assert all(0 <= message.log_time - message.publish_time < 60 * 10**9 for _, _, message in recorded)
    assert strings == {"/latched": ["before the recorder came"], "/said": [str(number) for number in range(50)]}
    with AnyReader([output]) as bag:
        assert {one.topic: one.msgtype for one in bag.connections}["/sensor"] == "sensor_msgs/msg/Image"
        qos = {one.topic: one.ext.offered_qos_profiles[0] for one in bag.connections
               if isinstance(one.ext, ConnectionExtRosbag2)}
    assert qos["/latched"].durability.name == "TRANSIENT_LOCAL"
    assert qos["/sensor"].reliability.name == "BEST_EFFORT"


def test_existing_output_is_refused(graph: Graph, tmp_path: Path) -> None:
    output = write_strings(tmp_path / "out.mcap", 1)
    before = output.read_bytes()
    recorder = graph.start("bag_recorder_node", output=str(output))
    assert recorder.wait() == 2
    (line,) = recorder.log.splitlines()
    assert f"{output}: exists already" in line
    assert output.read_bytes() == before


def test_full_disk_is_reported_and_survived(graph: Graph, tmp_path: Path) -> None:
    output = tmp_path / "out.mcap"
    recorder = graph.start("bag_recorder_node", output=str(output), topics=["/said"])
    said = graph.speak(String, "/said")
    reports = graph.listen(DiagnosticArray, "/diagnostics", 1)
    said.publish(String(data="first"))
    graph.until(lambda: reports and values_of(reports[-1])["messages"] == "1", "the first message")
    resource.prlimit(recorder.process.pid, resource.RLIMIT_FSIZE, (10_000, 10_000))
    said.publish(String(data="x" * 20_000))
    graph.until(lambda: reports[-1].status[0].level == b"\2", "the error")
    assert "out.mcap: " in reports[-1].status[0].message
    assert recorder.process.poll() is None
    assert recorder.stop() == 1
    assert not output.exists()
    with (tmp_path / "out.mcap.partial").open("rb") as file:
        read = [deserialize_message(message.data, String).data for _, _, message in make_reader(file).iter_messages()]
    assert read == ["first"]


def test_a_type_that_no_library_knows_is_recorded(graph: Graph, tmp_path: Path) -> None:
    output = tmp_path / "out.mcap"
    recorder = graph.start("bag_recorder_node", output=str(output), topics=["/mission/goals"])
    goals = graph.speak(Goals, "/mission/goals")
    reports = graph.listen(DiagnosticArray, "/diagnostics", 1)
    sent = Goals(header=Header(frame_id="map"), goals=[PoseStamped(pose=Pose(position=Point(x=3.0)))])
    goals.publish(sent)
    graph.until(lambda: reports and values_of(reports[-1])["messages"] == "1", "the message")
    (offered,) = graph.node.get_publishers_info_by_topic("/mission/goals")
    assert recorder.stop() == 0
    assert "[WARN]" not in recorder.log
    with AnyReader([output]) as bag:
        ((connection, _, data),) = bag.messages()
        assert connection.msgtype == "nav_msgs/msg/Goals"
        read: Any = bag.deserialize(data, connection.msgtype)
        assert read.goals[0].pose.position.x == 3.0
    assert deserialize_message(bytes(data), Goals) == sent
    with output.open("rb") as file:
        ((_, channel, _),) = make_reader(file).iter_messages()
    assert channel.metadata["topic_type_hash"] == str(offered.topic_type_hash)


@pytest.mark.thorough
def test_a_type_without_a_definition_on_disk_is_recorded(graph: Graph, tmp_path: Path) -> None:
    modules = tmp_path / "modules"
    for place in python_folders("nav_msgs"):  # without PREFIX/share beside it
        shutil.copytree(place, modules / "nav_msgs")
    graph.environment["PYTHONPATH"] = os.pathsep.join([str(modules), os.environ.get("PYTHONPATH", "")])
    output = tmp_path / "out.mcap"
    recorder = graph.start("bag_recorder_node", output=str(output), topics=["/mission/goals"])
    goals = graph.speak(Goals, "/mission/goals")
    reports = graph.listen(DiagnosticArray, "/diagnostics", 1)
    goals.publish(Goals())
    graph.until(lambda: reports and values_of(reports[-1])["messages"] == "1", "the message")
    assert recorder.stop() == 0
    (line,) = [line for line in recorder.log.splitlines() if "[WARN]" in line]
    assert "/mission/goals is recorded without the definition of nav_msgs/msg/Goals" in line
    with output.open("rb") as file:
        ((schema, _, message),) = make_reader(file).iter_messages()
    assert schema is not None
    assert (schema.name, schema.encoding, schema.data) == ("nav_msgs/msg/Goals", "", b"")
    assert deserialize_message(message.data, Goals) == Goals()  # bytes that fill up to an alignment are any


OF_A_TRACKER = ("homography", "image_stabilized", "tracker_node/track")


def fly(graph: Graph, namespace: str, flight: list[Shot]) -> None:
    """A camera and its tracker, until every frame is answered; what it publishes has a subscriber by then."""
    graph.start("tracker_node", namespace, queue_depth=0, start_s=0.0, wait_for_subscribers=2)
    topics = [f"{namespace}/{name}" for name in OF_A_TRACKER]
    heard = graph.listen(CameraInfo, topics[0])
    graph.until(lambda: all(graph.node.count_subscribers(topic) for topic in topics), "the recorder")
    images = graph.node.create_publisher(Image, f"{namespace}/image_raw", KEEP_ALL)
    graph.until(lambda: images.get_subscription_count() == 2, "tracker and recorder")
    for shot in flight:
        images.publish(image_message(shot.image, shot.stamp_ns))
    graph.until(lambda: len(heard) == len(flight), "all answers")


@pytest.mark.thorough
def test_two_trackers_are_recorded_into_one_file(graph: Graph, flight: list[Shot], tmp_path: Path) -> None:
    """All topics, of which the second camera's appear once the first camera is through."""
    output = tmp_path / "out.mcap"
    recorder = graph.start("bag_recorder_node", output=str(output))
    for namespace in ("/left", "/right"):
        fly(graph, namespace, flight)
    assert recorder.stop() == 0
    stamps: defaultdict[str, list[int]] = defaultdict(list)
    with AnyReader([output]) as bag:
        for connection, _, data in bag.messages():
            if connection.topic.startswith(("/left", "/right")) and not connection.topic.endswith("_event"):
                stamps[connection.topic].append(stamp_ns(bag.deserialize(data, connection.msgtype)))
    for namespace in ("/left", "/right"):
        for name in (*OF_A_TRACKER, "image_raw"):
            assert stamps[f"{namespace}/{name}"] == [shot.stamp_ns for shot in flight], name
