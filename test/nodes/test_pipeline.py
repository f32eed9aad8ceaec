"""Several nodes in one process, as users run them: over DDS, and with the numbers of nodes of their own."""

from __future__ import annotations

import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import Command
from diagnostic_msgs.msg import DiagnosticArray
from image_publisher import FRAMES, by_the_engine, shots
from live_graph import Graph, NodeProcess, image_message, stamp_ns
from rclpy.serialization import serialize_message
from recordings import entries, write_mcap
from sensor_msgs.msg import CameraInfo, Image, PointCloud2
from test_lifecycle import ACTIVATE, CLEANUP, CONFIGURE, DEACTIVATE, SHUTDOWN, change, homography, state
from test_velocimetry_node import SETTINGS, check_same

from stab_ros.io.bag import open_bag
from stab_ros.synthetic.flight import Shot

NODES = ["tracker", "velocimetry"]


def start(graph: Graph, *words: str, namespace: str = "/cam", **parameters: object) -> NodeProcess:
    return graph.start("pipeline_node", namespace, {}, (sys.executable, *words) if words else (), **parameters)


def by_name(reports: list[Any]) -> dict[str, Any]:
    """The last report of each node."""
    return {report.status[0].name: report.status[0] for report in reports}


def test_live_gives_what_the_commands_give(
    graph: Graph, flight: list[Shot], executable: Command, tmp_path: Path
) -> None:
    """Of a recording of which nothing is lost: all numbers, of one subscription to images."""
    flown = write_mcap(tmp_path / "flown.mcap", list(entries(flight)))
    clouds = {topic: graph.listen(PointCloud2, f"/cam/{topic}") for topic in ("velocity", "velocity_grid")}
    homographies: list[Any] = graph.listen(CameraInfo, "/cam/homography")
    config = tmp_path / "pipeline.yaml"
    lines = "".join(f"    {name}: {value}\n" for name, value in SETTINGS.items())
    config.write_text("/**:\n  ros__parameters:\n    queue_depth: 0\n"
                      "/**/pipeline_node:\n  ros__parameters:\n    nodes: [tracker, velocimetry]\n"
                      "    wait_for_nodes: 2\n/**/velocimetry_node:\n  ros__parameters:\n"
                      f"    use_camera_info: false\n    wait_for_subscribers: 1\n{lines}"
                      "/**/tracker_node:\n  ros__parameters:\n    wait_for_subscribers: 2\n")
    pipeline = graph.run("pipeline_node", ["--ros-args", "-r", "__ns:=/cam", "--params-file", str(config)])
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
    assert [serialize_message(one) for one in homographies] == tracked
    for topic, live in clouds.items():
        check_same([serialize_message(one) for one in live], offline[topic])
    assert "WARN" not in pipeline.log


def test_each_node_has_its_states(graph: Graph, flight: list[Shot]) -> None:
    """The tracker alone, then velocimetry too; images are taken while one of them does, and the rest goes on."""
    pipeline = graph.start("pipeline_node", "/cam", nodes=NODES, autostart=False, queue_depth=0, start_s=0.0,
                           use_camera_info=False)
    answers: list[Any] = graph.listen(CameraInfo, "/cam/homography")
    reports: list[Any] = graph.listen(DiagnosticArray, "/diagnostics")
    images = graph.node.create_publisher(Image, "/cam/image_raw", 100)
    tracker, velocimetry = "/cam/tracker_node", "/cam/velocimetry_node"

    def placed() -> str:
        status = by_name(reports).get(velocimetry.lstrip("/"))
        return "" if status is None else {one.key: one.value for one in status.values}.get("frames_placed", "")

    def show(shots: list[Shot]) -> list[CameraInfo]:
        graph.until(images.get_subscription_count, "images taken")
        assert images.get_subscription_count() == 1
        before = len(answers)
        for shot in shots:
            images.publish(image_message(shot.image, shot.stamp_ns))
        graph.until(lambda: len(answers) == before + len(shots), "every frame answered")
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
    assert change(graph, velocimetry, SHUTDOWN["unconfigured"])
    graph.until(lambda: velocimetry[5:] not in graph.node.get_node_names(), "the end of one node")
    assert change(graph, tracker, ACTIVATE)
    (again,) = show(flight[5:6])
    np.testing.assert_allclose(homography(again), flight[5].ref_H_cur, atol=0.05)
    assert change(graph, tracker, SHUTDOWN["active"])
    assert pipeline.wait() == 0
