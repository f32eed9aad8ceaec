"""Nodes driven from outside, as by a lifecycle manager: separate processes over DDS."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetState
from live_graph import Graph, image_message, stamp_ns, values_of
from recordings import IMAGE_TOPIC
from sensor_msgs.msg import CameraInfo, Image

from stab_ros.core.types import FloatArray
from stab_ros.io.bag import open_bag
from stab_ros.synthetic.flight import Shot

CONFIGURE, CLEANUP = Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_CLEANUP
ACTIVATE, DEACTIVATE = Transition.TRANSITION_ACTIVATE, Transition.TRANSITION_DEACTIVATE
SHUTDOWN = {"unconfigured": Transition.TRANSITION_UNCONFIGURED_SHUTDOWN,
            "inactive": Transition.TRANSITION_INACTIVE_SHUTDOWN, "active": Transition.TRANSITION_ACTIVE_SHUTDOWN}
LEADS_TO = {CONFIGURE: ("unconfigured", "inactive"), ACTIVATE: ("inactive", "active"),
            DEACTIVATE: ("active", "inactive"), CLEANUP: ("inactive", "unconfigured")}


def change(graph: Graph, node: str, transition: int) -> bool:
    request = ChangeState.Request(transition=Transition(id=transition))
    return bool(graph.call(ChangeState, f"{node}/change_state", request).success)


def state(graph: Graph, node: str) -> str:
    current: State = graph.call(GetState, f"{node}/get_state", GetState.Request()).current_state
    return str(current.label)


def homography(message: CameraInfo) -> FloatArray:
    K, R, P = np.reshape(message.k, (3, 3)), np.reshape(message.r, (3, 3)), np.reshape(message.p, (3, 4))
    H = P[:, :3] @ R @ np.linalg.inv(K)
    return np.asarray(H / H[2, 2])


def test_a_tracker_from_state_to_state(graph: Graph, flight: list[Shot]) -> None:
    tracker = graph.start("tracker_node", autostart=False, queue_depth=0, start_s=0.0)
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
    graph.start("tracker_node", autostart=False, threshold=-1.0)
    assert not change(graph, "tracker_node", CONFIGURE)
    assert state(graph, "tracker_node") == "unconfigured"
    graph.until(lambda: any("unconfigured: threshold" in one.status[0].message for one in reports), "the reason")
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
    graph.start("tracker_node")
    graph.until(lambda: graph.node.count_subscribers("image_raw"), "the tracker takes images")
    graph.until(lambda: state(graph, "tracker_node") == "active", "the end of the transition")
    assert change(graph, "tracker_node", DEACTIVATE)
    graph.until(lambda: graph.node.count_subscribers("image_raw") == 0, "no images taken")
    assert change(graph, "tracker_node", CLEANUP)
    assert change(graph, "tracker_node", CONFIGURE)
    assert change(graph, "tracker_node", ACTIVATE)
    graph.until(lambda: graph.node.count_subscribers("image_raw"), "the tracker takes images again")


@pytest.mark.thorough
def test_a_replay_pauses_and_goes_on(graph: Graph, recordings: dict[str, Path]) -> None:
    heard = graph.listen(Image, IMAGE_TOPIC)
    player = graph.start("bag_player_node", bag=str(recordings["mcap"]), autostart=False, wait_for_subscribers=1,
                         rate=0.5)
    with open_bag(recordings["mcap"]) as bag:
        count = bag.topics[IMAGE_TOPIC].count
    assert change(graph, "bag_player_node", CONFIGURE)
    assert change(graph, "bag_player_node", ACTIVATE)
    graph.until(lambda: len(heard) >= 3, "some images")
    assert change(graph, "bag_player_node", DEACTIVATE)
    assert change(graph, "bag_player_node", ACTIVATE)
    graph.until(lambda: len(heard) == count, "all images, each once")
    stamps = [stamp_ns(message) for message in heard]
    assert stamps == sorted(set(stamps))
    graph.until(lambda: state(graph, "bag_player_node") == "inactive", "the end")
    assert player.stop() == 0


@pytest.mark.thorough
def test_a_recording_pauses_and_is_complete_after_cleanup(graph: Graph, flight: list[Shot], tmp_path: Path) -> None:
    output = tmp_path / "parts.mcap"
    graph.start("bag_recorder_node", output=str(output), topics=["/camera"], autostart=False)
    images = graph.node.create_publisher(Image, "/camera", 100)
    assert change(graph, "bag_recorder_node", CONFIGURE)
    for part, recorded in ((flight[:2], True), (flight[2:3], False), (flight[3:5], True)):
        if recorded:
            assert change(graph, "bag_recorder_node", ACTIVATE)
            graph.until(images.get_subscription_count, "the recorder")
        for shot in part:
            images.publish(image_message(shot.image, shot.stamp_ns))
        if recorded:
            graph.until(images.wait_for_all_acked, "what was sent is received")
            assert change(graph, "bag_recorder_node", DEACTIVATE)
            graph.until(lambda: images.get_subscription_count() == 0, "the recorder pauses")
    assert change(graph, "bag_recorder_node", CLEANUP)
    with open_bag(output) as bag:
        assert bag.topics["/camera"].count == 4
    assert not change(graph, "bag_recorder_node", CONFIGURE)  # the file exists
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
