"""kill -9 of the recorder in mid-flight: every closed chunk is there, and everything reads the broken file as it is."""

from __future__ import annotations

import signal
import time
from pathlib import Path

import pytest
from conftest import Command
from live_graph import Graph, image_message, stamp_ns
from rclpy.qos import QoSProfile
from recordings import write_mcap
from sensor_msgs.msg import Image
from stabilised import table

from stab_ros.io.bag import open_bag
from stab_ros.io.cdr import read_stamp
from stab_ros.synthetic.flight import Shot

CHUNK_S = 1.0  # at least so often one is closed


@pytest.fixture
def broken(graph: Graph, flight: list[Shot], tmp_path: Path) -> tuple[Path, list[tuple[float, int]], float]:
    """What a recorder leaves that is killed while a camera sends: file, (second, stamp) of what was sent, its death."""
    recorder = graph.start("bag_recorder_node", output=str(tmp_path / "flight.mcap"), topics=["/cam/image_raw"])
    camera = graph.speak(Image, "/cam/image_raw", QoSProfile(depth=100))
    sent: list[tuple[float, int]] = []
    begin_s = time.monotonic()
    while time.monotonic() - begin_s < 4.0:
        number = len(sent) + 1
        message = image_message(flight[number % len(flight)].image, number)
        camera.publish(message)
        sent.append((time.monotonic(), stamp_ns(message)))
        time.sleep(0.04)
    recorder.process.send_signal(signal.SIGKILL)
    died_s = time.monotonic()
    assert recorder.wait() == -signal.SIGKILL
    return tmp_path / "flight.mcap.partial", sent, died_s


def test_nothing_older_than_a_second_is_lost(
    broken: tuple[Path, list[tuple[float, int]], float], graph: Graph, command: Command, executable: Command,
    tmp_path: Path
) -> None:
    file, sent, died_s = broken
    done = command("recover", file, tmp_path / "fixed.mcap")
    assert done.returncode == 0
    assert f"warning: {file}: " in done.stderr
    with open_bag(tmp_path / "fixed.mcap") as bag:
        assert not bag.warnings
        stamps = [read_stamp(message.data) for message in bag.messages()]
    assert stamps == [stamp for _, stamp in sent[: len(stamps)]]
    lost = [died_s - second for second, _ in sent[len(stamps) :]]
    assert max(lost, default=0.0) < CHUNK_S + 0.5  # and what the recorder had not taken yet

    shown = command("info", file)
    assert shown.returncode == 0
    assert "the recording was cut off" in shown.stderr
    stabilized = executable("stabilize", file, tmp_path / "out.mcap", "--homographies", tmp_path / "H.csv")
    assert stabilized.returncode == 0, stabilized.stderr
    assert "the recording was cut off" in stabilized.stderr
    assert [row["status"] for row in table(tmp_path / "H.csv")] == ["TRACKED"] * len(stamps)

    heard = graph.listen(Image, "/cam/image_raw", QoSProfile(depth=1000))
    player = graph.start("bag_player_node", bag=str(file), rate=100.0, wait_for_subscribers=1)
    assert player.wait() == 0
    graph.until(lambda: len(heard) == len(stamps), "all of it played")
    assert [stamp_ns(message) for message in heard] == stamps
    assert "the recording was cut off" in player.log


def test_the_next_recording_does_not_run_over_it(graph: Graph, flight: list[Shot], tmp_path: Path) -> None:
    write_mcap(tmp_path / "flight.mcap.partial", [])
    before = (tmp_path / "flight.mcap.partial").read_bytes()
    recorder = graph.start("bag_recorder_node", output=str(tmp_path / "flight.mcap"))
    assert recorder.wait() == 2
    assert "flight.mcap.partial: exists already" in recorder.log
    assert (tmp_path / "flight.mcap.partial").read_bytes() == before
    assert len(flight) == 10
