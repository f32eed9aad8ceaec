"""`lspiv`, `stiv` and orthophotos as users run them: the command's files, and a node over DDS with the same vectors."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import Command
from live_graph import Graph
from rclpy.serialization import serialize_message
from recordings import entries, write_mcap
from river_shots import GSD_M, SPEED_M_S, river_shots
from scipy.io import netcdf_file
from sensor_msgs.msg import Image, PointCloud2
from test_velocimetry_node import check_same
from visualization_msgs.msg import MarkerArray

from stab_ros.core.types import BoolArray
from stab_ros.io.bag import open_bag
from stab_ros.io.velocity_csv import read_velocities
from stab_ros.velocimetry.vectors import Vectors

FRAMES = 26
NODE = "/cam/velocimetry_node"
LINES = "[[[-1.8, -0.2], [1.8, -0.2]], [[-1.8, 0.2], [1.8, 0.2]]]"  # both in the water
METHODS: dict[str, dict[str, Any]] = {
    "lspiv": {"method": "lspiv", "lspiv.interval_s": 0.44, "lspiv.window_px": 32, "leave_out_bank": False},
    "stiv": {"method": "stiv", "stiv.interval_s": 0.44, "lines": LINES, "leave_out_bank": False},
    "orthophotos": {"orthophotos": True, "extract_s": 0.44, "features": 100},
}
LEAST = {"lspiv": 20, "stiv": 3, "orthophotos": 40}  # vectors in two intervals


@pytest.fixture(scope="module")
def river(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording of a second."""
    return write_mcap(tmp_path_factory.mktemp("river") / "river.mcap", list(entries(river_shots(FRAMES))))


def words(method: str) -> list[str]:
    given = {"gsd_m": GSD_M, **METHODS[method]}
    return [word for name, value in given.items() for word in ("-p", f"{name}:={value}")]


def in_the_water(vectors: Vectors) -> BoolArray:
    """(N,) those off the shores, which lie 0.6 m from the middle."""
    return np.asarray(np.abs(vectors.position_m[:, 1]) < 0.25)


@pytest.mark.thorough
@pytest.mark.parametrize("method", METHODS)
def test_all_outputs_tell_of_the_river(river: Path, command: Command, tmp_path: Path, method: str) -> None:
    paths = {name: tmp_path / f"V.{name}" for name in ("csv", "geojson", "nc", "html")}
    done = command("velocity", river, tmp_path / "V.mcap", "--csv", paths["csv"], "--tracks", paths["geojson"],
                      "--netcdf", paths["nc"], "--html", paths["html"], *words(method))
    assert done.returncode == 0, done.stderr
    vectors = read_velocities(paths["csv"])
    water = vectors[in_the_water(vectors)]
    assert (vectors.unit, len(vectors) >= LEAST[method]) == ("m", True)
    error = water.velocity_m_s - [SPEED_M_S, 0.0]
    assert np.median(np.abs(error[:, 0])) < 0.01 * SPEED_M_S
    sigma = np.sqrt(np.diagonal(water.total_covariance, axis1=1, axis2=2))
    assert np.mean(np.abs(error) < 3 * sigma) > 0.9
    assert len(json.loads(paths["geojson"].read_text())["features"]) == len(vectors)
    opened: Any = netcdf_file(paths["nc"], "r", mmap=False)
    np.testing.assert_array_equal(opened.variables["vx"][:], vectors.velocity_m_s[:, 0])
    opened.close()
    assert paths["html"].read_text().count("<img") >= 3
    with open_bag(tmp_path / "V.mcap") as bag:
        assert {"/cam/velocity", "/cam/velocity_grid", f"{NODE}/markers"} <= set(bag.topics)


@pytest.mark.thorough
@pytest.mark.parametrize("method", METHODS)
def test_live_gives_what_the_command_gives(
    graph: Graph, river: Path, command: Command, tmp_path: Path, method: str
) -> None:
    done = command("velocity", river, tmp_path / "offline.mcap", *words(method))
    assert done.returncode == 0, done.stderr
    clouds = {topic: graph.listen(PointCloud2, f"/cam/{topic}") for topic in ("velocity", "velocity_grid")}
    markers: list[Any] = graph.listen(MarkerArray, f"{NODE}/markers")
    pictures: list[Any] = graph.listen(Image, f"{NODE}/image_velocity")
    node = graph.start("velocimetry_node", "/cam", queue_depth=0, wait_for_subscribers=1, use_camera_info=False,
                       gsd_m=GSD_M, **METHODS[method])
    tracker = graph.start("tracker_node", "/cam", queue_depth=0, wait_for_subscribers=1)
    player = graph.start("bag_player_node", bag=str(river), wait_for_subscribers=2, rate=100.0)
    assert player.wait() == 0
    with open_bag(tmp_path / "offline.mcap") as bag:
        offline = {topic: [message.data for message in bag.messages([f"/cam/{topic}"])] for topic in clouds}
    graph.until(lambda: len(clouds["velocity"]) >= len(offline["velocity"]) - 1, "all intervals but the last")
    assert (tracker.stop(), node.stop()) == (0, 0)  # the interval under way is told at the end
    heard = [*clouds.values(), markers]
    graph.until(lambda: all(len(one) == len(offline["velocity"]) for one in heard) and pictures, "the last interval")
    for topic, live in clouds.items():
        check_same([serialize_message(one) for one in live], offline[topic])


@pytest.mark.thorough
def test_an_interval_that_is_too_long_is_told_by_its_parameter(
    river: Path, command: Command, tmp_path: Path
) -> None:
    done = command("velocity", river, tmp_path / "V.mcap", *words("stiv"), "-p", "stiv.interval_s:=60.0")
    assert done.returncode == 0, done.stderr
    assert "stiv.interval_s is longer" in done.stderr
