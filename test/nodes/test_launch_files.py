"""The launch files: what they would start exists, and tracker and georeferencing run as one of them starts them."""

from __future__ import annotations

import re
from importlib.metadata import entry_points
from pathlib import Path

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from georeferenced_stream import camera_info, shot
from launch_files import ROOT, described_arguments, started
from live_graph import Graph, image_message, values_of
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import CameraInfo, Image

NEEDED = {"discharge.launch.py": {"section": "section.csv"},
          "replay.launch.py": {"bag": "flown.mcap", "output": "done.mcap"}}
FILES = sorted((ROOT / "launch").glob("*.launch.py"))


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.name)
def test_what_a_launch_file_starts_is_there(file: Path) -> None:
    nodes = started(file, **NEEDED.get(file.name, {}))
    programs = {one.name for one in entry_points(group="console_scripts")}
    assert nodes
    for node in nodes:
        assert node.package == "stab_ros"
        assert node.executable in programs
        assert all(given.is_file() for given in node.parameters if isinstance(given, Path))


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.name)
def test_every_argument_is_described(file: Path) -> None:
    """As `ros2 launch --show-args` tells it; the words at the head of a file name the same ones."""
    told = described_arguments(file)
    usage = file.read_text().split('"""')[1]
    assert {name for name, text in told.items() if len(text) < 5} == set()
    assert {*re.findall(r"(\w+):=", usage)} <= told.keys()


def test_arguments_reach_the_nodes() -> None:
    left, right = started(ROOT / "launch" / "two_cameras.launch.py", second="/bow")
    assert (left.namespace, right.namespace) == ("/left", "/bow")
    *_, discharge = started(ROOT / "launch" / "discharge.launch.py", section="a b.csv", config="my.yaml")
    assert discharge.parameters == [ROOT / "config" / "discharge.yaml", {"section_file": "a b.csv"}]
    replay = ROOT / "launch" / "replay.launch.py"
    replayed = started(replay, bag="a.mcap", output="b.mcap", rate="2.0", evaluate="false")
    assert [node.executable for node in replayed] == ["tracker_node", "bag_recorder_node", "bag_player_node"]
    assert {"bag": "a.mcap", "rate": 2.0, "wait_for_subscribers": 1} in replayed[2].parameters
    with pytest.raises(ValueError, match="needs bag"):
        started(replay, output="b.mcap")


@pytest.mark.parametrize(("file", "node", "name"), [
    ("tracker", "tracker_node", "roi"), ("evaluator", "evaluator_node", "exclude"),
    ("velocimetry", "velocimetry_node", "lines"), ("discharge", "velocimetry_node", "roi"),
])
def test_lists_are_arguments_that_stay_text(file: str, node: str, name: str) -> None:
    """With a parameter of its own only where one is given: an empty one would take the place of that in the file."""
    path, text = ROOT / "launch" / f"{file}.launch.py", "[[[0, 130], [960, 150], [960, 420]]]"
    needed = NEEDED.get(path.name, {})
    without, given = started(path, **needed), started(path, **{name: text}, **needed)
    (before,), (now,) = ([one for one in nodes if one.executable == node] for nodes in (without, given))
    assert now.parameters == [*before.parameters, {name: text}]
    assert f"{name}:='{text}'" in now.ros_arguments


def test_tracker_and_georeferencing_are_launched_on_one_camera(graph: Graph, tmp_path: Path) -> None:
    """With a namespace, topics and parameter files of the user's."""
    config = tmp_path / "georeference.yaml"
    config.write_text("/**/georeference_node:\n  ros__parameters:\n    orientation: dynamic_stabilization\n"
                      "    height_m: 25.0\n    queue_depth: 0\n    wait_for_subscribers: 1\n")
    tracker = tmp_path / "tracker.yaml"
    tracker.write_text("/**/tracker_node:\n  ros__parameters:\n    queue_depth: 0\n    start_s: 0.0\n"
                       "    wait_for_subscribers: 1\n    exclude: '[[[0, 0], [40, 0], [40, 20], [0, 20]]]'\n")
    heard = graph.listen(DiagnosticArray, "/drone/georeference_node/status")
    infos = graph.listen(CameraInfo, "/drone/ortho_info")
    for node in started(ROOT / "launch" / "georeference.launch.py", namespace="/drone", config=str(config),
                        tracker_config=str(tracker), image="/usb/picture", camera_info="/usb/info"):
        graph.run(node.executable, node.ros_arguments)
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    graph.node.create_publisher(CameraInfo, "/usb/info", latched).publish(camera_info())
    pictures = graph.node.create_publisher(Image, "/usb/picture", 10)
    graph.until(lambda: pictures.get_subscription_count() == 2, "both nodes taking pictures")
    for number in range(4):
        pictures.publish(image_message(shot(number).image, shot(number).stamp_ns))
    graph.until(lambda: len(heard) == len(infos) == 4, "every frame placed")
    values = [values_of(one) for one in heard]
    assert {(one["state"], one["orientation"]) for one in values} == {("PLACED", "dynamic_stabilization")}
    assert float(values[0]["gsd_m"]) == pytest.approx(25 / 380, rel=0.1)
    assert all(np.any(info.k) for info in infos)
