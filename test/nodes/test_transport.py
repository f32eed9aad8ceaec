"""Shared memory between our processes: enough of it, unless the user has chosen otherwise."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path

import pytest
from live_graph import Graph
from sensor_msgs.msg import Image

from stab_ros.nodes.transport import FAST_DDS, FastDds, is_chosen_by_user, loaded_fast_dds

ENOUGH_BYTES = 32 << 20
USER = """<dds><profiles/></dds>"""
RENAMED = {"heartbeat_period": "heartbeatPeriod"}  # in Fast DDS 3


@pytest.fixture(scope="module")
def fast_dds() -> FastDds:
    """What this rclpy sends with; the suite runs on Jazzy (2) and on Kilted (3)."""
    loaded = loaded_fast_dds()
    assert loaded is not None
    return loaded


def segments(pid: int) -> list[int]:
    """Sizes of the shared memory that a process has opened, bytes, its own and others'."""
    lines = Path(f"/proc/{pid}/maps").read_text().splitlines()
    spans = [re.match(r"(\w+)-(\w+) .*/dev/shm/fast(?:rtps|dds)_[0-9a-f]+$", line) for line in lines]
    return [int(span[2], 16) - int(span[1], 16) for span in spans if span]


def content(profile: Path) -> Iterator[tuple[str, str]]:
    """Tags and texts of a profile, by their names in Fast DDS 2."""
    for element in ET.parse(profile).iter():
        tag = element.tag.partition("}")[2]
        yield RENAMED.get(tag, tag), (element.text or "").strip()


def test_a_node_has_shared_memory_for_images_and_fast_dds_takes_all_of_the_profile(graph: Graph) -> None:
    tracker = graph.start("tracker_node", "/cam")
    graph.speak(Image, "/cam/image_raw")
    assert max(segments(tracker.process.pid)) >= ENOUGH_BYTES
    assert "XMLPARSER" not in tracker.log
    assert "PROFILES_FILE" not in tracker.log


@pytest.mark.thorough
def test_the_profile_of_the_user_is_kept(graph: Graph, tmp_path: Path, fast_dds: FastDds) -> None:
    own = tmp_path / "own.xml"
    own.write_text(USER)
    graph.environment[fast_dds.variable] = str(own)
    tracker = graph.start("tracker_node", "/cam")
    graph.speak(Image, "/cam/image_raw")
    assert min(segments(tracker.process.pid)) < ENOUGH_BYTES, "the observer's segment is of our profile, not its own"


def test_both_profiles_say_the_same() -> None:
    two, three = (list(content(one.profile)) for one in FAST_DDS)
    assert two == three
    assert ("heartbeatPeriod", "") in two


@pytest.mark.parametrize("name", ["FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE",
                                  "FASTDDS_BUILTIN_TRANSPORTS"])
def test_every_variable_of_fast_dds_is_known(name: str, fast_dds: FastDds) -> None:
    assert is_chosen_by_user(fast_dds, {name: str(fast_dds.profile)})
    assert not is_chosen_by_user(fast_dds, {"HOME": "/"})


def test_a_profile_that_fast_dds_finds_in_the_folder_is_one_of_the_user(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch, fast_dds: FastDds) -> None:
    monkeypatch.chdir(tmp_path)
    fast_dds.in_folder.write_text(USER)
    assert is_chosen_by_user(fast_dds, {})
