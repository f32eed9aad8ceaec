"""Signals, any number of them and at any time: exit code 0, a closed bag, no shared memory left behind."""

from __future__ import annotations

import signal
import time
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from live_graph import Graph, NodeProcess, image_message, values_of
from mcap.reader import make_reader
from recordings import entries, write_mcap
from sensor_msgs.msg import Image
from std_msgs.msg import String

from stab_ros.synthetic.flight import Shot

SHARED_MEMORY = Path("/dev/shm")
NODES = ("tracker_node", "evaluator_node", "georeference_node", "velocimetry_node", "bag_player_node",
         "bag_recorder_node")


Segment = tuple[str, int]  # path and inode: other processes of this machine take up the same names again


def opened(pid: int) -> set[Segment]:
    """Segments of messages that a process has mapped; those of the observer are among them.

    Ports, of 52 kB, are left out: processes that have nothing else in common share them, and who is last removes them.
    """
    words = [line.split() for line in Path(f"/proc/{pid}/maps").read_text().splitlines()]
    return {(line[-1], int(line[4])) for line in words
            if line[-1].startswith(f"{SHARED_MEMORY}/fastrtps_") and "_port" not in line[-1]}


def present() -> set[Segment]:
    """Of all processes of this machine, and what killed ones have left, which others may take up again."""
    return {(str(path), _inode(path)) for path in SHARED_MEMORY.glob("fastrtps*")}


def _inode(path: Path) -> int:
    try:
        return path.stat().st_ino
    except FileNotFoundError:
        return 0


def parameters_of(name: str, bag: Path, output: Path) -> dict[str, Any]:
    """What a node cannot do without."""
    needed: dict[str, dict[str, Any]] = {
        "georeference_node": {"orientation": "stationary_nadir", "height_m": 30.0},
        "bag_player_node": {"bag": str(bag), "loop": True},
        "bag_recorder_node": {"output": str(output)},
    }
    return needed.get(name, {})


def started(graph: Graph, name: str, flight: list[Shot], folder: Path) -> NodeProcess:
    """A node at work."""
    bag = write_mcap(folder / "in.mcap", list(entries(flight)))
    node = graph.start(name, "/cam", **parameters_of(name, bag, folder / "out.mcap"))
    reports = graph.listen(DiagnosticArray, "/diagnostics")
    graph.until(lambda: reports and values_of(reports[-1])["lifecycle"] == "active", f"{name} at work")
    graph.until(lambda: opened(node.process.pid), "its shared memory")
    return node


@pytest.mark.parametrize("name", NODES)
@pytest.mark.parametrize("numbers", [[signal.SIGINT] * 7, [signal.SIGTERM]], ids=["SIGINT x7", "SIGTERM"])
def test_signals_leave_nothing_behind(
    graph: Graph, flight: list[Shot], tmp_path: Path, name: str, numbers: list[int]
) -> None:
    before = present()
    node = started(graph, name, flight, tmp_path)
    if name in ("tracker_node", "evaluator_node"):
        topic = "image_raw" if name == "tracker_node" else "image_stabilized"
        graph.speak(Image, f"/cam/{topic}").publish(image_message(flight[0].image, 1))
    elif name == "bag_recorder_node":
        graph.node.create_publisher(String, "/said", 1)
        graph.until(lambda: graph.node.count_subscribers("/said"), "the recording")
    time.sleep(0.3)
    used = opened(node.process.pid) - before
    assert used
    for number in numbers:
        node.process.send_signal(number)
        time.sleep(0.02)
    assert node.wait() == 0, node.log
    assert "Traceback" not in node.log
    graph.close_observer()
    assert not used & present()
    if name == "bag_recorder_node":
        with (tmp_path / "out.mcap").open("rb") as file:
            assert make_reader(file, validate_crcs=True).get_summary() is not None
        assert not (tmp_path / "out.mcap.partial").exists()


def runs_our_code(maps: Path) -> bool:
    """Whether the process whose /proc/PID/maps this is has come as far as numpy."""
    return "/numpy/" in maps.read_text()


@pytest.mark.parametrize("name", NODES)
def test_sigint_at_every_moment_of_the_start(graph: Graph, flight: list[Shot], tmp_path: Path, name: str) -> None:
    bag = write_mcap(tmp_path / "in.mcap", list(entries(flight)))
    used: set[Segment] = set()
    for step in range(6):
        before = present()
        node = graph.start(name, **parameters_of(name, bag, tmp_path / f"out{step}.mcap"))
        maps = Path(f"/proc/{node.process.pid}/maps")  # before numpy it is Python itself that starts
        graph.until(partial(runs_our_code, maps), "our own code")
        time.sleep(0.35 * step)
        used |= opened(node.process.pid) - before
        assert node.stop() == 0, node.log
        assert "Traceback" not in node.log
    graph.close_observer()
    assert not used & present()
    assert not list(tmp_path.glob("*.partial"))
