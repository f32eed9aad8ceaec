"""Nodes driven from outside, as by a lifecycle manager: separate processes over DDS."""

from __future__ import annotations

from itertools import product
from pathlib import Path

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetState
from live_graph import Graph, NodeProcess, image_message, values_of
from live_stream import homography_message
from rcl_interfaces.msg import LoggerLevel, ParameterType, ParameterValue
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.srv import GetLoggerLevels, SetLoggerLevels, SetParameters
from rclpy.qos import HistoryPolicy, QoSProfile
from rclpy.serialization import serialize_message
from recordings import IMAGE_TOPIC
from sensor_msgs.msg import CameraInfo, Image
from std_msgs.msg import String

from stab_ros.core.types import FloatArray, Frame
from stab_ros.io.bag import BagWriter, open_bag, topic_of
from stab_ros.io.saved_reference import SavedReference, save_reference
from stab_ros.synthetic.flight import Shot
from stab_ros.tracking.static_map import StaticMap

CONFIGURE, CLEANUP = Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_CLEANUP
ACTIVATE, DEACTIVATE = Transition.TRANSITION_ACTIVATE, Transition.TRANSITION_DEACTIVATE
SHUTDOWN = {"unconfigured": Transition.TRANSITION_UNCONFIGURED_SHUTDOWN,
            "inactive": Transition.TRANSITION_INACTIVE_SHUTDOWN, "active": Transition.TRANSITION_ACTIVE_SHUTDOWN}
LEADS_TO = {CONFIGURE: ("unconfigured", "inactive"), ACTIVATE: ("inactive", "active"),
            DEACTIVATE: ("active", "inactive"), CLEANUP: ("inactive", "unconfigured")}
LATCHED_OFFER = "- {history: keep_last, depth: 1, reliability: reliable, durability: transient_local}"


def change(graph: Graph, node: str, transition: int) -> bool:
    request = ChangeState.Request(transition=Transition(id=transition))
    return bool(graph.call(ChangeState, f"{node}/change_state", request).success)


def state(graph: Graph, node: str) -> str:
    current: State = graph.call(GetState, f"{node}/get_state", GetState.Request()).current_state
    return str(current.label)


def said(process: NodeProcess, level: str) -> list[str]:
    """What the node has logged at a level, without what the compiler of kernels says."""
    lines = [line.split("]: ", 1)[1] for line in process.log.splitlines() if line.startswith(f"[{level}] ")]
    return [line for line in lines if not line.startswith("compil")]


def reported(reports: list[DiagnosticArray], lifecycle: str) -> list[tuple[int, str, str]]:
    """Level, message and state of the reports from one state of the lifecycle."""
    return [(ord(one.status[0].level), one.status[0].message, values_of(one).get("state", "")) for one in reports
            if values_of(one)["lifecycle"] == lifecycle]


def homography(message: CameraInfo) -> FloatArray:
    K, R, P = np.reshape(message.k, (3, 3)), np.reshape(message.r, (3, 3)), np.reshape(message.p, (3, 4))
    H = P[:, :3] @ R @ np.linalg.inv(K)
    return np.asarray(H / H[2, 2])


def test_a_tracker_from_state_to_state(graph: Graph, flight: list[Shot]) -> None:
    tracker = graph.start("tracker_node", autostart=False, queue_depth=0, start_s=0.0, stale_s=0.1)
    reports = graph.listen(DiagnosticArray, "/diagnostics")
    answers = graph.listen(CameraInfo, "homography")
    images = graph.node.create_publisher(Image, "image_raw", 100)

    def answered(shots: list[Shot]) -> list[CameraInfo]:
        graph.until(images.get_subscription_count, "the tracker takes images")
        before = len(answers)
        for shot in shots:
            images.publish(image_message(shot.image, shot.stamp_ns))
        graph.until(lambda: len(answers) == before + len(shots), "every frame answered")
        return answers[before:]

    assert state(graph, "tracker_node") == "unconfigured"
    assert graph.node.count_publishers("homography") == 0
    assert graph.set_parameter("tracker_node", "threshold", 2.5) == (True, "")
    assert change(graph, "tracker_node", CONFIGURE)
    graph.until(lambda: graph.node.count_publishers("homography"), "the outputs")
    assert images.get_subscription_count() == 0

    assert change(graph, "tracker_node", ACTIVATE)
    first = answered(flight[:5])
    assert change(graph, "tracker_node", DEACTIVATE)
    graph.until(lambda: images.get_subscription_count() == 0, "no images taken")
    reports.clear()
    graph.until(lambda: len(reported(reports, "inactive")) == 2, "reports")
    assert set(reported(reports, "inactive")) == {(0, "inactive", "INACTIVE")}, "that no images come is no fault"
    assert change(graph, "tracker_node", ACTIVATE)
    after = answered(flight[5:])
    for shot, message in zip(flight, [*first, *after], strict=True):  # all to the reference of before
        np.testing.assert_allclose(homography(message), shot.ref_H_cur, atol=0.05)

    assert change(graph, "tracker_node", DEACTIVATE)
    assert change(graph, "tracker_node", CLEANUP)
    graph.until(lambda: graph.node.count_publishers("homography") == 0, "the outputs are gone")
    assert change(graph, "tracker_node", CONFIGURE)
    assert change(graph, "tracker_node", ACTIVATE)
    (anew,) = answered(flight[5:6])
    np.testing.assert_allclose(homography(anew), np.eye(3), atol=1e-12)
    assert change(graph, "tracker_node", SHUTDOWN["active"])
    assert tracker.wait() == 0
    ready = "ready, taking images from /image_raw"
    assert said(tracker, "INFO") == ["configured", ready, "deactivated", ready, "deactivated", "cleaned up",
                                     "configured", ready, "shut down"]
    assert not said(tracker, "WARN")


@pytest.mark.parametrize(("node", "topic"), [("evaluator_node", "image_stabilized"), ("velocimetry_node", "image_raw")])
def test_a_pause_is_no_fault_of_the_stream(graph: Graph, flight: list[Shot], node: str, topic: str) -> None:
    process = graph.start(node, autostart=False, stale_s=0.1)
    reports = graph.listen(DiagnosticArray, "/diagnostics")
    images = graph.node.create_publisher(Image, topic, 100)
    homographies = graph.node.create_publisher(CameraInfo, "homography", 100)
    assert change(graph, node, CONFIGURE)
    graph.until(lambda: reported(reports, "inactive"), "a report")
    assert reported(reports, "inactive") == [(0, "inactive", "INACTIVE")]
    assert change(graph, node, ACTIVATE)
    graph.until(lambda: images.get_subscription_count() and homographies.get_subscription_count(), "the inputs")
    image = image_message(flight[0].image, 10**9)
    homographies.publish(homography_message(image))
    images.publish(image)
    graph.until(lambda: any(values_of(one).get("frames_in") == "1" for one in reports), "a frame")
    assert change(graph, node, DEACTIVATE)
    reports.clear()
    graph.until(lambda: len(reported(reports, "inactive")) == 2, "reports")
    assert reported(reports, "inactive")[-1] == (0, "inactive", "INACTIVE")
    assert change(graph, node, ACTIVATE)
    graph.until(lambda: reported(reports, "active"), "a report")
    assert reported(reports, "active")[0][2] == "WAITING", "for the next image"
    ready = f"ready, taking images from /{topic}"
    assert said(process, "INFO") == ["configured", ready, "deactivated", ready]


def test_what_cannot_be_activated_is_inactive_and_says_why(graph: Graph, tmp_path: Path) -> None:
    """A reference of an earlier run in which there is nothing to see."""
    blank = Frame(np.full((120, 160), 90, np.uint8), "mono8", 10**9, "cam")
    saved = tmp_path / "blank.mcap"
    save_reference(saved, SavedReference(blank, StaticMap.of_mask(np.ones((120, 160), np.bool_)), 0, None))
    reports = graph.listen(DiagnosticArray, "/diagnostics")
    tracker = graph.start("tracker_node", autostart=False, reference_path=str(saved))
    assert change(graph, "tracker_node", CONFIGURE)
    assert not change(graph, "tracker_node", ACTIVATE)
    assert state(graph, "tracker_node") == "inactive"
    graph.until(lambda: any("in the reference" in message for _, message, _ in reported(reports, "inactive")), "why")
    assert not change(graph, "tracker_node", ACTIVATE)
    assert graph.node.count_subscribers("image_raw") == 0
    (line, again) = said(tracker, "ERROR")
    assert line == again
    assert line.startswith("cannot activate: ")
    assert change(graph, "tracker_node", CLEANUP)
    assert graph.set_parameter("tracker_node", "reference_path", "") == (True, "")
    assert change(graph, "tracker_node", CONFIGURE)
    assert change(graph, "tracker_node", ACTIVATE)
    graph.until(lambda: graph.node.count_subscribers("image_raw"), "the tracker takes images")
    assert said(tracker, "ERROR") == [line, line]


def test_what_does_not_fit_a_saved_reference_is_mended_where_it_is_inactive(
    graph: Graph, flight: list[Shot], tmp_path: Path
) -> None:
    saved, first = tmp_path / "saved.mcap", flight[0]
    ground = StaticMap.of_mask(np.ones(first.image.shape, np.bool_))
    save_reference(saved, SavedReference(Frame(first.image, "mono8", 5, "cam"), ground, 3, None))
    tracker = graph.start("tracker_node", autostart=False, reference_path=str(saved), queue_depth=0,
                          roi="[[[0, 0], [9, 0], [9, 9]]]")
    assert change(graph, "tracker_node", CONFIGURE)
    assert not change(graph, "tracker_node", ACTIVATE)
    assert graph.set_parameter("tracker_node", "roi", "[[[900, 900], [950, 900], [950, 950]]]") == (True, "")
    assert not change(graph, "tracker_node", ACTIVATE)
    assert graph.set_parameter("tracker_node", "roi", "") == (True, "")
    assert change(graph, "tracker_node", ACTIVATE)
    assert "resuming from the reference of stamp 5 ns" in tracker.log
    answers, images = graph.listen(CameraInfo, "homography"), graph.speak(Image, "image_raw")
    images.publish(image_message(flight[3].image, flight[3].stamp_ns))
    graph.until(lambda: answers, "an answer")
    np.testing.assert_allclose(homography(answers[0]), flight[3].ref_H_cur, atol=0.05)


def test_logger_levels_are_set_at_the_start_and_by_service(graph: Graph) -> None:
    tracker = graph.run("tracker_node", ["--ros-args", "-r", "__ns:=/camera", "-p", "autostart:=false",
                                         "--log-level", "camera.tracker_node:=error"])
    assert change(graph, "/camera/tracker_node", CONFIGURE)
    asked = GetLoggerLevels.Request(names=["camera.tracker_node"])
    (level,) = graph.call(GetLoggerLevels, "/camera/tracker_node/get_logger_levels", asked).levels
    assert level.level == LoggerLevel.LOG_LEVEL_ERROR
    info = LoggerLevel(name="camera.tracker_node", level=LoggerLevel.LOG_LEVEL_INFO)
    wanted = SetLoggerLevels.Request(levels=[info])
    (result,) = graph.call(SetLoggerLevels, "/camera/tracker_node/set_logger_levels", wanted).results
    assert result.successful
    assert change(graph, "/camera/tracker_node", CLEANUP)
    graph.until(lambda: said(tracker, "INFO"), "what is logged now")
    assert said(tracker, "INFO") == ["cleaned up"]


def test_transitions_in_every_order(graph: Graph) -> None:
    graph.start("evaluator_node", autostart=False)
    at = "unconfigured"
    for transition in (ACTIVATE, DEACTIVATE, CLEANUP, CONFIGURE, CONFIGURE, DEACTIVATE, CLEANUP, CONFIGURE, ACTIVATE,
                       CONFIGURE, ACTIVATE, CLEANUP, DEACTIVATE, ACTIVATE, DEACTIVATE, CLEANUP, CONFIGURE):
        start, end = LEADS_TO[transition]
        possible = start == at
        assert change(graph, "evaluator_node", transition) == possible
        at = end if possible else at
        assert state(graph, "evaluator_node") == at


def test_what_cannot_be_configured_says_why_and_may_be_mended(graph: Graph) -> None:
    reports = graph.listen(DiagnosticArray, "/diagnostics")
    tracker = graph.start("tracker_node", autostart=False, threshold=-1.0)
    assert not change(graph, "tracker_node", CONFIGURE)
    assert state(graph, "tracker_node") == "unconfigured"
    graph.until(lambda: any("unconfigured: threshold" in one.status[0].message for one in reports), "the reason")
    (line,) = said(tracker, "ERROR")
    assert line.startswith("cannot configure: threshold: -1.0 ")
    assert graph.node.count_publishers("homography") == 0
    assert graph.set_parameter("tracker_node", "threshold", 2.0) == (True, "")
    assert change(graph, "tracker_node", CONFIGURE)
    taken, reason = graph.set_parameter("tracker_node", "treshold", 3.0)
    assert not taken
    assert "threshold" in reason
    taken, reason = graph.set_parameter("tracker_node", "queue_depth", 0)
    assert not taken
    assert "after cleanup" in reason
    assert change(graph, "tracker_node", CLEANUP)
    assert graph.set_parameter("tracker_node", "queue_depth", 0) == (True, "")


@pytest.mark.thorough
def test_a_node_that_brings_itself_up_is_managed_too(graph: Graph) -> None:
    tracker = graph.start("tracker_node")
    graph.until(lambda: graph.node.count_subscribers("image_raw"), "the tracker takes images")
    graph.until(lambda: state(graph, "tracker_node") == "active", "the end of the transition")
    assert change(graph, "tracker_node", DEACTIVATE)
    graph.until(lambda: graph.node.count_subscribers("image_raw") == 0, "no images taken")
    assert change(graph, "tracker_node", CLEANUP)
    assert change(graph, "tracker_node", CONFIGURE)
    assert change(graph, "tracker_node", ACTIVATE)
    graph.until(lambda: graph.node.count_subscribers("image_raw"), "the tracker takes images again")
    ready = "ready, taking images from /image_raw"
    assert said(tracker, "INFO") == [ready, "deactivated", "cleaned up", "configured", ready]


def test_a_replay_pauses_and_goes_on(graph: Graph, tmp_path: Path) -> None:
    """Each message once, though a pause falls between messages of the same log time, and what is latched but once."""
    topics, rounds = ("/a", "/b", "/c", "/d"), 200
    with BagWriter(tmp_path / "bag.mcap") as writer:
        for topic in topics:
            writer.add_topic(topic_of(topic, "std_msgs/msg/String", LATCHED_OFFER if topic == "/a" else ""))
        for number, topic in product(range(rounds), topics):
            time_ns = 10**9 + number * 10**7
            writer.write(topic, time_ns, time_ns, serialize_message(String(data=str(number))))
    heard = {topic: graph.listen(String, topic, QoSProfile(history=HistoryPolicy.KEEP_ALL)) for topic in topics}
    player = graph.start("bag_player_node", bag=str(tmp_path / "bag.mcap"), autostart=False, rate=1000.0,
                         wait_for_subscribers=len(topics), start_offset=0.05)
    assert change(graph, "bag_player_node", CONFIGURE)
    for _ in range(8):
        assert change(graph, "bag_player_node", ACTIVATE)
        if not change(graph, "bag_player_node", DEACTIVATE):  # the replay came to its end first
            break
    else:
        assert len(heard["/d"]) < rounds - 5
        assert change(graph, "bag_player_node", ACTIVATE)
    graph.until(lambda: state(graph, "bag_player_node") == "inactive", "the end")
    assert player.stop() == 0
    expected = [str(number) for number in range(5, rounds)]
    assert {topic: [one.data for one in heard[topic]] for topic in topics} == {
        topic: [*"01234", *expected] if topic == "/a" else expected for topic in topics}


def test_a_replay_is_shut_down_in_its_middle(graph: Graph, recordings: dict[str, Path]) -> None:
    heard = graph.listen(Image, IMAGE_TOPIC)
    player = graph.start("bag_player_node", bag=str(recordings["mcap"]), autostart=False, wait_for_subscribers=1,
                         rate=0.1)
    assert change(graph, "bag_player_node", CONFIGURE)
    assert change(graph, "bag_player_node", ACTIVATE)
    graph.until(lambda: heard, "an image")
    assert change(graph, "bag_player_node", SHUTDOWN["active"])
    assert player.wait() == 0
    assert said(player, "INFO") == ["configured", "activated", "shut down"]


def set_topics(graph: Graph, names: list[str]) -> None:
    value = ParameterValue(type=ParameterType.PARAMETER_STRING_ARRAY, string_array_value=names)
    request = SetParameters.Request(parameters=[ParameterMessage(name="topics", value=value)])
    assert graph.call(SetParameters, "bag_recorder_node/set_parameters", request).results[0].successful


def until_recorded(graph: Graph, reports: list[DiagnosticArray], count: int) -> None:
    """A pause lets go what has arrived and not been written."""
    graph.until(lambda: reports and values_of(reports[-1]).get("messages") == str(count), f"{count} messages recorded")


@pytest.mark.thorough
def test_a_recording_pauses_and_is_complete_after_cleanup(graph: Graph, flight: list[Shot], tmp_path: Path) -> None:
    output = tmp_path / "parts.mcap"
    recorder = graph.start("bag_recorder_node", output=str(output), topics=["a b"], autostart=False)
    images = graph.node.create_publisher(Image, "/camera", 100)
    reports, sent = graph.listen(DiagnosticArray, "/diagnostics"), 0
    assert not change(graph, "bag_recorder_node", CONFIGURE)
    assert "cannot configure: topics: 'a b' is no name of a topic, it must be as /camera/image_raw" in recorder.log
    set_topics(graph, ["/camera"])
    assert change(graph, "bag_recorder_node", CONFIGURE)
    for part, recorded in ((flight[:2], True), (flight[2:3], False), (flight[3:5], True)):
        if recorded:
            assert change(graph, "bag_recorder_node", ACTIVATE)
            graph.until(images.get_subscription_count, "the recorder")
        for shot in part:
            images.publish(image_message(shot.image, shot.stamp_ns))
        if recorded:
            sent += len(part)
            until_recorded(graph, reports, sent)
            assert change(graph, "bag_recorder_node", DEACTIVATE)
            graph.until(lambda: images.get_subscription_count() == 0, "the recorder pauses")
    assert change(graph, "bag_recorder_node", CLEANUP)
    with open_bag(output) as bag:
        assert bag.topics["/camera"].count == 4
    assert not change(graph, "bag_recorder_node", CONFIGURE)  # the file exists
    line = said(recorder, "ERROR")[-1]
    assert line.endswith("or overwrite it with -p overwrite:=true")
    assert graph.set_parameter("bag_recorder_node", "output", str(tmp_path / "next.mcap")) == (True, "")
    assert change(graph, "bag_recorder_node", CONFIGURE)


@pytest.mark.thorough
def test_frames_of_a_start_are_answered_when_it_is_broken_off(graph: Graph, flight: list[Shot]) -> None:
    reports = graph.listen(DiagnosticArray, "/diagnostics")
    graph.start("tracker_node", queue_depth=0, start_s=5.0)
    answers, images = graph.listen(CameraInfo, "homography"), graph.speak(Image, "image_raw")
    for shot in flight[:6]:
        images.publish(image_message(shot.image, shot.stamp_ns))
    graph.until(lambda: reports and values_of(reports[-1])["frames_in"] == "6", "all have come")
    assert change(graph, "tracker_node", DEACTIVATE)
    graph.until(lambda: len(answers) == 6, "all are answered")
    for shot, message in zip(flight, answers, strict=False):
        np.testing.assert_allclose(homography(message), shot.ref_H_cur, atol=0.05)
