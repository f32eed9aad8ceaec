"""The velocimetry node as users run it: a separate process over DDS, whose vectors are those of the command."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import Command
from diagnostic_msgs.msg import DiagnosticArray
from georeferenced_stream import LATCHED
from live_graph import Graph, image_message, values_of
from rclpy.serialization import serialize_message
from recordings import entries, write_mcap
from sensor_msgs.msg import Image, NavSatFix, PointCloud2
from std_msgs.msg import Float64
from visualization_msgs.msg import MarkerArray

from stab_ros.imaging.camera import Camera
from stab_ros.imaging.pose import Pose
from stab_ros.io.bag import open_bag
from stab_ros.io.camera_file import CameraFile, write_camera_file
from stab_ros.io.point_cloud import read_cloud
from stab_ros.synthetic.flight import Shot

NODE = "/cam/velocimetry_node"
SETTINGS: dict[str, Any] = {"gsd_m": 0.02, "extract_s": 0.2, "max_gap_s": 1.0, "features": 200}


def tables(messages: list[bytes]) -> list[tuple[int, Any]]:
    found = [read_cloud(cdr) for cdr in messages]
    return [(header.stamp_ns, table) for header, table in found]


def check_same(live: list[bytes], offline: list[bytes]) -> None:
    """That the clouds hold the same numbers to 1e-9."""
    assert len(live) == len(offline) > 1
    for (stamp_ns, table), (same_ns, same) in zip(tables(live), tables(offline), strict=True):
        assert stamp_ns == same_ns
        assert table.dtype.names == same.dtype.names
        assert len(table) == len(same)
        for name in table.dtype.names or ():
            np.testing.assert_allclose(table[name], same[name], rtol=1e-9, atol=1e-9, err_msg=name)


def test_live_gives_what_the_command_gives(
    graph: Graph, flight: list[Shot], command: Command, tmp_path: Path
) -> None:
    flown = write_mcap(tmp_path / "flown.mcap", list(entries(flight)))
    clouds = {topic: graph.listen(PointCloud2, f"/cam/{topic}") for topic in ("velocity", "velocity_grid")}
    markers: list[Any] = graph.listen(MarkerArray, f"{NODE}/markers")
    pictures: list[Any] = graph.listen(Image, f"{NODE}/image_velocity")
    node = graph.start("velocimetry_node", "/cam", queue_depth=0, wait_for_subscribers=1, use_camera_info=False,
                       **SETTINGS)
    tracker = graph.start("tracker_node", "/cam", queue_depth=0, wait_for_subscribers=1)
    player = graph.start("bag_player_node", bag=str(flown), wait_for_subscribers=2, rate=100.0)
    assert player.wait() == 0

    given = [word for name, value in SETTINGS.items() for word in ("-p", f"{name}:={value}")]
    done = command("velocity", flown, tmp_path / "offline.mcap", *given)
    assert done.returncode == 0, done.stderr
    with open_bag(tmp_path / "offline.mcap") as bag:
        offline = {topic: [message.data for message in bag.messages([f"/cam/{topic}"])] for topic in clouds}
    graph.until(lambda: len(clouds["velocity"]) >= len(offline["velocity"]) - 1, "all intervals but the last")
    assert (tracker.stop(), node.stop()) == (0, 0)  # the interval under way is told at the end
    heard = [*clouds.values(), markers]
    graph.until(lambda: all(len(one) == len(offline["velocity"]) for one in heard), "the last interval")
    for topic, live in clouds.items():
        check_same([serialize_message(one) for one in live], offline[topic])
    assert {one.header.frame_id for one in clouds["velocity"]} == {"map"}
    assert pictures
    assert (pictures[0].encoding, pictures[0].height) == ("bgr8", flight[0].image.shape[0])


def test_bad_parameters_end_the_node(graph: Graph) -> None:
    node = graph.start("velocimetry_node", "/cam", extract_s=0.0)
    assert node.wait() == 2
    assert "extract_s" in node.log


def test_what_it_waits_for_is_said(graph: Graph) -> None:
    reports: list[Any] = graph.listen(DiagnosticArray, "/diagnostics")
    node = graph.start("velocimetry_node", "/cam", wait_for_subscribers=1)
    awaited = "1 subscriber of velocity"
    graph.until(lambda: any(awaited in one.status[0].message for one in reports), "what it waits for")
    assert values_of(reports[-1])["unit"] == "px/s"
    assert node.stop() == 0


@pytest.mark.thorough
def test_a_water_level_is_missed_and_one_before_the_first_image_is_not_stale(
    graph: Graph, flight: list[Shot], tmp_path: Path
) -> None:
    view = Camera(np.array([[400.0, 0, 240], [0, 400, 135], [0, 0, 1]]), np.zeros(0), "plumb_bob", (480, 270))
    pose = Pose.of_angles(np.array([0, 0, 60.0]), 1.57, 1.5, 0.0)
    write_camera_file(tmp_path / "camera.yaml", CameraFile(view, pose=pose, pose_covariance=1e-4 * np.eye(6)))
    reports: list[Any] = graph.listen(DiagnosticArray, "/diagnostics")
    graph.node.create_publisher(Float64, "/with/water_level", LATCHED).publish(Float64(data=0.5))
    settings: dict[str, Any] = {"camera_file": str(tmp_path / "camera.yaml"), "origin": "46.1, 7.2, 300",
                                "queue_depth": 0}
    nodes = {name: graph.start("velocimetry_node", name, orientation="stationary_gcps", **settings)
             for name in ("/without", "/with")}
    origins: list[Any] = graph.listen(NavSatFix, "/with/velocimetry_node/origin", LATCHED)
    images = {name: graph.speak(Image, f"{name}/image_raw") for name in nodes}
    stamp_ns = 10**18  # of a clock, so that a level of stamp 0 would be 30 years old

    def told(name: str) -> list[Any]:
        return [one.status[0] for one in reports if one.status[0].name.startswith(f"{name[1:]}/")
                and values_of(one)["state"] == "PLACED"]

    def reports_of(name: str) -> int:
        return sum(one.status[0].name.startswith(f"{name[1:]}/") for one in reports)

    graph.until(lambda: all(reports_of(name) > 3 for name in nodes), "seconds, in which the level comes")
    for number, shot in enumerate(flight):
        for publisher in images.values():
            publisher.publish(image_message(shot.image, stamp_ns + number * 40_000_000))
    graph.until(lambda: all(told(name) for name in nodes), "frames placed")
    assert "no water_level has come, and no wse_m is given" in told("/without")[-1].message
    assert "the water surface is taken to lie at 0 m" in nodes["/without"].log
    assert "water" not in told("/with")[-1].message
    values = {pair.key: pair.value for pair in told("/with")[-1].values}
    graph.until(lambda: origins, "the origin of the map")
    assert (origins[0].latitude, origins[0].longitude, origins[0].altitude) == (46.1, 7.2, 300.0)
    assert (values["wse_m"], float(values["water_level_age_s"]) < 1) == ("0.5", True)


@pytest.mark.thorough
def test_in_metres_it_takes_the_calibration_of_the_camera(graph: Graph) -> None:
    """As shipped settings have it, with a scale and no file of a camera."""
    reports: list[Any] = graph.listen(DiagnosticArray, "/diagnostics")
    node = graph.start("velocimetry_node", "/cam", gsd_m=0.02)
    graph.until(lambda: any("camera_info" in one.status[0].message for one in reports), "what it waits for")
    assert values_of(reports[-1])["unit"] == "m/s"
    assert node.stop() == 0
