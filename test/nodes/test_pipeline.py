"""Several nodes in one process, as users run them: over DDS, and with the numbers of nodes of their own."""

from __future__ import annotations

import signal
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from conftest import Command
from diagnostic_msgs.msg import DiagnosticArray
from image_publisher import FRAMES, by_the_engine, shots
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from live_graph import Graph, NodeProcess, image_message
from rcl_interfaces.msg import LoggerLevel
from rcl_interfaces.srv import GetLoggerLevels, SetLoggerLevels
from rclpy.qos import ReliabilityPolicy
from rclpy.serialization import serialize_message
from recordings import entries, write_mcap
from sensor_msgs.msg import CameraInfo, Image, PointCloud2
from test_lifecycle import ACTIVATE, CLEANUP, CONFIGURE, DEACTIVATE, SHUTDOWN, change, homography, state
from test_velocimetry_node import SETTINGS, check_same

from stab_ros.io.bag import open_bag
from stab_ros.io.homography_message import read_homography
from stab_ros.synthetic.flight import Shot

NODES = ["tracker", "velocimetry"]
PROGRAM = """
import sys

import rclpy
from rclpy.executors import ExternalShutdownException, MultiThreadedExecutor, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from sensor_msgs.msg import CameraInfo

from stab_ros.nodes.image_hub import ImageHub
from stab_ros.nodes.tracker_node import TrackerNode
from stab_ros.nodes.velocimetry_node import VelocimetryNode

rclpy.init(args=["--ros-args", "-r", "__ns:=/cam"])
own, hub = Node("own"), ImageHub()
hub.awaited = 2  # else the tracker, which waits for subscribers, misses the first images
again = own.create_publisher(CameraInfo, "again", 500)
own.create_subscription(CameraInfo, "homography", again.publish, 500)
all_frames = Parameter("queue_depth", value=0)
tracker = TrackerNode(images=hub, parameter_overrides=[all_frames, Parameter("wait_for_subscribers", value=3)])
velocimetry = VelocimetryNode(images=hub, parameter_overrides=[all_frames])
executor = MultiThreadedExecutor(4) if sys.argv[1] == "multi" else SingleThreadedExecutor()
for node in (own, tracker, velocimetry) if sys.argv[1] == "forgotten" else (own, hub, tracker, velocimetry):
    executor.add_node(node)
try:
    executor.spin()
except (KeyboardInterrupt, ExternalShutdownException):
    pass
"""


def start(graph: Graph, folder: Path, sections: Mapping[str, Mapping[str, object]]) -> NodeProcess:
    """The pipeline with a parameter file of these sections."""
    config = folder / "pipeline.yaml"
    config.write_text(yaml.safe_dump({node: {"ros__parameters": {**values}} for node, values in sections.items()}))
    return graph.run("pipeline_node", ["--ros-args", "-r", "__ns:=/cam", "--params-file", str(config)])


def placed(reports: list[Any]) -> set[str]:
    """How many frames were placed, as reports of velocimetry tell it."""
    return {pair.value for one in reports for pair in one.status[0].values if pair.key == "frames_placed"}


def test_live_gives_what_the_commands_give(
    graph: Graph, flight: list[Shot], executable: Command, tmp_path: Path
) -> None:
    """Of a recording of which nothing is lost: all numbers, of one subscription to images."""
    flown = write_mcap(tmp_path / "flown.mcap", list(entries(flight)))
    clouds = {topic: graph.listen(PointCloud2, f"/cam/{topic}") for topic in ("velocity", "velocity_grid")}
    homographies: list[Any] = graph.listen(CameraInfo, "/cam/homography")
    pipeline = start(graph, tmp_path, {
        "/**/pipeline_node": {"nodes": NODES, "wait_for_nodes": 2},
        "/**/tracker_node": {"queue_depth": 0, "wait_for_subscribers": 2},
        "/**/velocimetry_node": {"queue_depth": 0, "wait_for_subscribers": 1, "use_camera_info": False, **SETTINGS}})
    player = graph.start("bag_player_node", bag=str(flown), wait_for_subscribers=1, rate=100.0)
    graph.until(lambda: graph.node.count_subscribers("/cam/image_raw"), "images taken")
    assert graph.node.count_subscribers("/cam/image_raw") == 1
    assert player.wait() == 0

    given = [word for name, value in SETTINGS.items() for word in ("-p", f"{name}:={value}")]
    done = executable("velocity", flown, tmp_path / "offline.mcap", *given)
    assert done.returncode == 0, done.stderr
    assert executable("stabilize", flown, tmp_path / "stable.mcap").returncode == 0
    with open_bag(tmp_path / "offline.mcap") as bag, open_bag(tmp_path / "stable.mcap") as stable:
        offline = {topic: [message.data for message in bag.messages([f"/cam/{topic}"])] for topic in clouds}
        tracked = [message.data for message in stable.messages(["/cam/homography"])]
    graph.until(lambda: len(homographies) == len(tracked), "every frame answered")
    graph.until(lambda: len(clouds["velocity"]) >= len(offline["velocity"]) - 1, "all intervals but the last")
    assert pipeline.stop() == 0, pipeline.log
    graph.until(lambda: all(len(one) == len(offline["velocity"]) for one in clouds.values()), "the last interval")
    for message, cdr in zip(homographies, tracked, strict=True):
        (now_ns, now_H), (stamp_ns, offline_H) = read_homography(serialize_message(message)), read_homography(cdr)
        assert now_ns == stamp_ns
        np.testing.assert_array_equal(np.array(now_H), np.array(offline_H))
    for topic, live in clouds.items():
        check_same([serialize_message(one) for one in live], offline[topic])
    assert "WARN" not in pipeline.log


def test_a_player_in_the_process_hands_its_images_over(graph: Graph, tmp_path: Path) -> None:
    """Not over DDS, and none is lost though it plays faster than the others work."""
    flown = write_mcap(tmp_path / "flown.mcap", list(entries(shots())))
    answers: list[Any] = graph.listen(CameraInfo, "/cam/homography", 500)
    reports: list[Any] = graph.listen(DiagnosticArray, "/diagnostics")
    seen: set[str] = set()  # who subscribed to images
    pipeline = start(graph, tmp_path, {
        "/**/pipeline_node": {"nodes": ["player", *NODES]},
        "/**/bag_player_node": {"bag": str(flown), "rate": 100.0},
        "/**/tracker_node": {"queue_depth": 0, "wait_for_subscribers": 2},
        "/**/velocimetry_node": {"queue_depth": 0, "use_camera_info": False}})

    def all_answered() -> bool:
        if graph.node.count_publishers("/cam/image_raw"):  # while it plays
            seen.update(one.node_name for one in graph.node.get_subscriptions_info_by_topic("/cam/image_raw"))
        return len(answers) == FRAMES

    graph.until(all_answered, "every frame answered")
    graph.until(lambda: f"{FRAMES}" in placed(reports), "every frame placed")
    assert not seen
    assert {"0"} == {pair.value for one in reports for pair in one.status[0].values if pair.key == "frames_dropped"}
    for answer, H in zip(answers, by_the_engine(), strict=True):
        np.testing.assert_allclose(homography(answer), H, rtol=0, atol=1e-9)
    assert pipeline.stop() == 0


def shut_down(graph: Graph, node: str, at: str) -> None:
    """Without its answer: on a busy machine, the node may be gone before somebody who is new has got it."""
    client = graph.node.create_client(ChangeState, f"{node}/change_state")
    graph.until(client.service_is_ready, "the service")
    client.call_async(ChangeState.Request(transition=Transition(id=SHUTDOWN[at])))


def test_a_player_in_the_process_waits_for_the_others_and_says_so(graph: Graph, tmp_path: Path) -> None:
    """For all that take images, but not for one that has ended."""
    flown = write_mcap(tmp_path / "flown.mcap", list(entries(shots())))
    answers: list[Any] = graph.listen(CameraInfo, "/cam/homography", 500)
    reports: list[Any] = graph.listen(DiagnosticArray, "/diagnostics")
    pipeline = start(graph, tmp_path, {
        "/**/pipeline_node": {"nodes": ["player", *NODES]},
        "/**/bag_player_node": {"bag": str(flown), "rate": 100.0},
        "/**/tracker_node": {"queue_depth": 0, "wait_for_subscribers": 1},
        "/**/velocimetry_node": {"autostart": False}})
    missing = "2 nodes of the process to take images, so far 1, not yet /cam/velocimetry_node"

    def waiting() -> set[str]:
        return {one.status[0].name for one in reports if one.status[0].message == f"waiting for {missing}"}

    graph.until(lambda: waiting() == {"cam/bag_player_node", "cam/tracker_node"}, "both waiting")
    graph.until(lambda: f"no images are taken: they wait for {missing}" in pipeline.log, "the warning")
    assert not answers
    shut_down(graph, "/cam/velocimetry_node", "unconfigured")
    graph.until(lambda: len(answers) == FRAMES, "every frame answered")
    assert pipeline.log.count("no images are taken: they wait for") == 1
    assert pipeline.stop() == 0


def test_a_player_in_the_process_does_not_wait_for_a_tracker_that_sleeps(graph: Graph, tmp_path: Path) -> None:
    flown = write_mcap(tmp_path / "flown.mcap", list(entries(shots())))
    images: list[Any] = graph.listen(Image, "/cam/image_raw", 500)
    pipeline = start(graph, tmp_path, {
        "/**/pipeline_node": {"nodes": ["player", "tracker"]},
        "/**/bag_player_node": {"bag": str(flown), "rate": 100.0, "wait_for_subscribers": 1},
        "/**/tracker_node": {"idle": "sleep"}})
    graph.until(lambda: len(images) == FRAMES, "every image played")
    assert pipeline.stop() == 0


def test_each_node_has_its_states(graph: Graph, flight: list[Shot]) -> None:
    """The tracker alone, then velocimetry too; images are taken while one of them does, and the rest goes on."""
    pipeline = graph.start("pipeline_node", "/cam", nodes=NODES, autostart=False, queue_depth=0, start_s=0.0,
                           use_camera_info=False)
    answers: list[Any] = graph.listen(CameraInfo, "/cam/homography")
    images = graph.node.create_publisher(Image, "/cam/image_raw", 100)
    tracker, velocimetry = "/cam/tracker_node", "/cam/velocimetry_node"

    def show(some: list[Shot]) -> list[CameraInfo]:
        graph.until(images.get_subscription_count, "images taken")
        assert images.get_subscription_count() == 1
        before = len(answers)
        for shot in some:
            images.publish(image_message(shot.image, shot.stamp_ns))
        graph.until(lambda: len(answers) == before + len(some), "every frame answered")
        return answers[before:]

    assert {state(graph, node) for node in (tracker, velocimetry)} == {"unconfigured"}
    for node in (tracker, velocimetry):
        assert change(graph, node, CONFIGURE)
    assert images.get_subscription_count() == 0
    assert change(graph, tracker, ACTIVATE)
    first = show(flight[:3])
    assert state(graph, velocimetry) == "inactive"
    assert change(graph, velocimetry, ACTIVATE)
    second = show(flight[3:6])
    assert change(graph, velocimetry, DEACTIVATE)
    assert change(graph, velocimetry, CLEANUP)
    third = show(flight[6:])
    for shot, message in zip(flight, [*first, *second, *third], strict=True):  # all to one reference
        np.testing.assert_allclose(homography(message), shot.ref_H_cur, atol=0.05)
    assert change(graph, tracker, DEACTIVATE)
    graph.until(lambda: images.get_subscription_count() == 0, "no images taken")
    shut_down(graph, velocimetry, "unconfigured")
    graph.until(lambda: velocimetry[5:] not in graph.node.get_node_names(), "the end of one node")
    assert change(graph, tracker, ACTIVATE)
    (again,) = show(flight[5:6])
    np.testing.assert_allclose(homography(again), flight[5].ref_H_cur, atol=0.05)
    shut_down(graph, tracker, "active")
    assert pipeline.wait() == 0


@pytest.mark.parametrize("kind", ["single", "multi"])
def test_nodes_share_images_in_a_process_of_somebody_else(graph: Graph, kind: str, tmp_path: Path) -> None:
    answers: list[Any] = graph.listen(CameraInfo, "/cam/homography", 500)
    again: list[Any] = graph.listen(CameraInfo, "/cam/again", 500)
    reports: list[Any] = graph.listen(DiagnosticArray, "/diagnostics")
    log = tmp_path / "log"
    with log.open("w") as errors, subprocess.Popen(
            [sys.executable, "-c", PROGRAM, kind], env=graph.environment, stderr=errors) as process:
        try:
            images = graph.speak(Image, "/cam/image_raw", 300)
            graph.until(images.get_subscription_count, "both nodes taking images")
            assert images.get_subscription_count() == 1
            for shot in shots():
                images.publish(image_message(shot.image, shot.stamp_ns))
            graph.until(lambda: len(answers) == len(again) == FRAMES, "every frame answered, and heard by another node")
            graph.until(lambda: f"{FRAMES}" in placed(reports), "every frame placed")
        finally:
            process.send_signal(signal.SIGINT)
    assert "Traceback" not in log.read_text()
    assert {report.status[0].name for report in reports} == {"cam/tracker_node", "cam/velocimetry_node"}
    for answer, H in zip(answers, by_the_engine(), strict=True):
        np.testing.assert_allclose(np.reshape(answer.r, (3, 3)), H, rtol=0, atol=1e-9)


@pytest.mark.thorough
def test_a_shared_subscription_that_nobody_spins_is_said(graph: Graph, tmp_path: Path) -> None:
    log = tmp_path / "log"
    with log.open("w") as errors, subprocess.Popen(
            [sys.executable, "-c", PROGRAM, "forgotten"], env=graph.environment, stderr=errors) as process:
        try:
            graph.until(lambda: "[cam.image_hub]: no images are taken: nobody spins this node" in log.read_text(),
                        "the warning")
        finally:
            process.send_signal(signal.SIGINT)
    assert log.read_text().count("nobody spins") == 1


@pytest.mark.parametrize(("parameters", "remap", "words"), [
    ({"nodes": ["tracker", "velocimetri"]}, {}, "did you mean velocimetry?"),
    ({"nodes": ["tracker", "tracker"]}, {}, "must name each node once"),
    ({"nodes": []}, {}, "nodes: is given an empty value"),
    ({"nodes": NODES, "wait_for_nodes": 3}, {}, "wait_for_nodes: 3 is out of range, it must lie in [0, 2]"),
    ({"nodes": NODES, "extract_s": 0.0}, {}, "velocimetry: extract_s"),
    ({"nodes": NODES}, {"__node": "river"}, "rename one alone"),
    ({"nodes": ["discharge"], "section_file": "none.csv"}, {}, "discharge: none.csv"),
], ids=["name", "twice", "empty", "wait", "parameter", "names", "file"])
def test_what_cannot_be_ends_with_a_line(
    graph: Graph, parameters: dict[str, Any], remap: dict[str, str], words: str
) -> None:
    pipeline = graph.start("pipeline_node", "/cam", remap, **parameters)
    assert pipeline.wait() == 2
    assert words in pipeline.log.splitlines()[-1]
    assert pipeline.log.splitlines()[-1].startswith("pipeline_node: ")
    assert "Traceback" not in pipeline.log


def test_signals_end_all_nodes_at_once(graph: Graph) -> None:
    """Which share the images by the quality of service of the pipeline's own node, that has a logger too."""
    graph.listen(CameraInfo, "/cam/homography")
    parameters: dict[str, Any] = {
        "nodes": ["tracker", "georeference", "velocimetry"], "orientation": "stationary_nadir", "height_m": 20.0,
        "use_camera_info": False, "qos_overrides./cam/image_raw.subscription.reliability": "best_effort"}
    pipeline = graph.start("pipeline_node", "/cam", **parameters)
    graph.until(lambda: graph.node.count_subscribers("/cam/image_raw"), "images taken")
    (taken,) = graph.node.get_subscriptions_info_by_topic("/cam/image_raw")
    assert taken.qos_profile.reliability == ReliabilityPolicy.BEST_EFFORT
    error = LoggerLevel(name="cam.pipeline_node", level=LoggerLevel.LOG_LEVEL_ERROR)
    (result,) = graph.call(SetLoggerLevels, "/cam/pipeline_node/set_logger_levels",
                           SetLoggerLevels.Request(levels=[error])).results
    assert result.successful
    (level,) = graph.call(GetLoggerLevels, "/cam/pipeline_node/get_logger_levels",
                          GetLoggerLevels.Request(names=[error.name])).levels
    assert level.level == error.level
    assert pipeline.stop(signal.SIGTERM) == 0
    assert "Traceback" not in pipeline.log
