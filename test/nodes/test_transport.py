"""Shared memory between our processes: enough of it, unless the user has chosen otherwise."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from live_graph import Graph
from sensor_msgs.msg import Image

from stab_ros.nodes.transport import PROFILE, is_chosen_by_user

ENOUGH_BYTES = 32 << 20
USER = """<dds><profiles xmlns="http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles"/></dds>"""


def segments(pid: int) -> list[int]:
    """Sizes of the shared memory that a process has opened, bytes, its own and others'."""
    lines = Path(f"/proc/{pid}/maps").read_text().splitlines()
    spans = [re.match(r"(\w+)-(\w+) .*/dev/shm/fastrtps_[0-9a-f]+$", line) for line in lines]
    return [int(span[2], 16) - int(span[1], 16) for span in spans if span]


def test_a_node_has_shared_memory_for_images(graph: Graph) -> None:
    tracker = graph.start("tracker_node", "/cam")
    graph.speak(Image, "/cam/image_raw")
    assert max(segments(tracker.process.pid)) >= ENOUGH_BYTES


def test_the_profile_of_the_user_is_kept(graph: Graph, tmp_path: Path) -> None:
    own = tmp_path / "own.xml"
    own.write_text(USER)
    graph.environment["FASTRTPS_DEFAULT_PROFILES_FILE"] = str(own)
    tracker = graph.start("tracker_node", "/cam")
    graph.speak(Image, "/cam/image_raw")
    assert min(segments(tracker.process.pid)) < ENOUGH_BYTES, "the observer's segment is of our profile, not its own"


@pytest.mark.parametrize("name", ["FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE",
                                  "FASTDDS_BUILTIN_TRANSPORTS"])
def test_every_variable_of_fast_dds_is_known(name: str) -> None:
    assert is_chosen_by_user({name: str(PROFILE)})
    assert not is_chosen_by_user({"HOME": "/"})
