"""Disks that are full, read-only, or vanish; inputs that change while they are read."""

from __future__ import annotations

import shutil
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from ailing import needs_root, small_disk
from bag_makers import FLIGHT, TOPICS
from conftest import Command
from diagnostic_msgs.msg import DiagnosticArray
from live_graph import Graph, values_of
from mcap.reader import make_reader
from rclpy.serialization import deserialize_message
from recordings import entries, write_mcap
from stabilised import table
from std_msgs.msg import String

from stab_ros.io.bag import BagWriter, open_bag
from stab_ros.synthetic.flight import Shot

KB = 1000


@pytest.fixture
def disk(tmp_path: Path) -> Iterator[Path]:
    """Three MB of room: chunks are of one."""
    with small_disk(tmp_path / "disk", 3072) as folder:
        yield folder


def by_mcap(path: Path) -> list[str]:
    """The strings in a bag, read by mcap's own reader, CRCs checked."""
    with path.open("rb") as file:
        messages = make_reader(file, validate_crcs=True).iter_messages()
        return [deserialize_message(message.data, String).data for _, _, message in messages]


def has_recorded(reports: list[Any], least: int) -> bool:
    """Whether the last report of a recorder says that it has so many messages."""
    return bool(reports) and int(values_of(reports[-1])["messages"]) >= least



@needs_root
def test_a_recorder_whose_disk_is_full_lives_and_keeps_what_it_has(graph: Graph, disk: Path) -> None:
    recorder = graph.start("bag_recorder_node", output=str(disk / "out.mcap"), topics=["/said"])
    said = graph.speak(String, "/said")
    reports = graph.listen(DiagnosticArray, "/diagnostics", 1)
    texts = [f"{number} " + "x" * 100 * KB for number in range(40)]
    for number, text in enumerate(texts, start=1):
        said.publish(String(data=text))
        least = min(number, 25)
        graph.until(partial(has_recorded, reports, least), "the messages")
    graph.until(lambda: reports[-1].status[0].level == b"\2", "the error")
    assert "out.mcap: No space left on device, what was written so far is in" in reports[-1].status[0].message
    assert recorder.process.poll() is None
    assert recorder.stop() == 1
    read = by_mcap(disk / "out.mcap.partial")
    assert len(read) >= 20
    assert read == texts[: len(read)]
    assert not (disk / "out.mcap").exists()


@needs_root
@pytest.mark.parametrize("option", [[], ["--no-image", "--keep-raw"], ["--video", "V.mp4"]])
def test_a_command_whose_disk_is_full_leaves_a_readable_part(
    flight: list[Shot], executable: Command, tmp_path: Path, disk: Path, option: list[str]
) -> None:
    bag = write_mcap(tmp_path / "in.mcap", list(entries(flight * 4)))
    done = executable("stabilize", bag, disk / "out.mcap", "--homographies", disk / "H.csv", *option, cwd=disk)
    assert done.returncode == 1, done.stderr
    (line,) = done.stderr.splitlines()
    assert str(disk) in line
    assert "No space left on device" in line
    assert not (disk / "out.mcap").exists()
    with open_bag(disk / "out.mcap.partial") as partial:
        read = list(partial.messages(["/cam/homography"]))
    assert 0 < len(read) < 4 * len(flight)


@needs_root
def test_tables_that_find_no_room_break_off(flight: list[Shot], executable: Command, tmp_path: Path) -> None:
    bag = write_mcap(tmp_path / "in.mcap", list(entries(flight * 6)))
    with small_disk(tmp_path / "tiny", 4) as tiny:
        done = executable("stabilize", bag, tmp_path / "out.mcap", "--homographies", tiny / "H.csv", "--no-image")
        assert done.returncode == 1
        (line,) = done.stderr.splitlines()
        assert "H.csv" in line
        assert not (tiny / "H.csv").exists()


@pytest.mark.parametrize("vanish", ["deleted", "moved"])
def test_the_folder_of_a_recording_vanishes(graph: Graph, tmp_path: Path, vanish: str) -> None:
    folder = tmp_path / "flights"
    folder.mkdir()
    recorder = graph.start("bag_recorder_node", output=str(folder / "out.mcap"), topics=["/said"])
    said = graph.speak(String, "/said")
    reports = graph.listen(DiagnosticArray, "/diagnostics", 1)
    said.publish(String(data="first"))
    graph.until(lambda: reports and values_of(reports[-1])["messages"] == "1", "the first message")
    if vanish == "deleted":
        shutil.rmtree(folder)
    else:
        folder.rename(tmp_path / "elsewhere")
    graph.until(lambda: reports[-1].status[0].level == b"\2", "the error, though nothing is said any more")
    assert "out.mcap.partial: was deleted or moved while it was written" in reports[-1].status[0].message
    assert recorder.stop() == 1
    if vanish == "moved":
        assert by_mcap(tmp_path / "elsewhere" / "out.mcap.partial") == ["first"]


def test_the_folder_of_an_output_vanishes(flight: list[Shot], tmp_path: Path) -> None:
    bag, folder = write_mcap(tmp_path / "in.mcap", list(entries(flight * 30))), tmp_path / "out"
    folder.mkdir()
    words = [sys.executable, "-m", "stab_ros", "stabilize", str(bag), str(folder / "out.mcap")]
    process = subprocess.Popen(words, stderr=subprocess.PIPE, text=True)
    while not ((folder / "out.mcap.partial").exists() and (folder / "out.mcap.partial").stat().st_size > 500 * KB):
        time.sleep(0.01)
        assert process.poll() is None
    shutil.rmtree(folder)
    _, said = process.communicate(timeout=60)
    assert process.returncode == 1
    (line,) = said.splitlines()
    assert "was deleted or moved while it was written" in line


@needs_root
def test_a_file_system_that_is_read_only(flight: list[Shot], command: Command, tmp_path: Path, disk: Path) -> None:
    bag = write_mcap(tmp_path / "in.mcap", list(entries(flight[:2])))
    subprocess.run(["mount", "-o", "remount,ro", disk], check=True)
    for words in (["stabilize", bag, disk / "out.mcap"], ["recover", bag, disk / "out.mcap"],
                  ["convert", bag, disk / "out.mcap"], ["evaluate", bag, "--json", disk / "J.json"]):
        done = command(*words)
        assert done.returncode == 2
        (line,) = done.stderr.splitlines()
        assert "Read-only file system" in line


def test_an_input_that_grows_while_it_is_read(command: Command, executable: Command, tmp_path: Path) -> None:
    """A recording still under way, and written to by its recorder while the command reads it."""
    growing, stop = tmp_path / "growing.mcap.partial", threading.Event()

    def write() -> None:
        with BagWriter(tmp_path / "growing.mcap") as writer:
            for topic in TOPICS:
                writer.add_topic(topic)
            while not stop.is_set():
                for message in FLIGHT:
                    writer.write(*message)
                writer.flush_chunk()
                time.sleep(0.001)

    thread = threading.Thread(target=write)
    thread.start()
    try:
        while not growing.exists() or growing.stat().st_size < 300 * KB:
            time.sleep(0.01)
        shown = command("info", growing)
        saved = command("recover", growing, tmp_path / "saved.mcap")
        done = executable("stabilize", growing, tmp_path / "out.mcap", "--homographies", tmp_path / "H.csv")
    finally:
        stop.set()
        thread.join()
    for one in (shown, saved, done):
        assert one.returncode == 0, one.stderr
        assert "warning: " in one.stderr
        assert "the recording was cut off" in one.stderr
    with open_bag(tmp_path / "saved.mcap") as bag:
        assert not bag.warnings
        found = list(bag.messages())
    assert len(found) >= 20
    assert {message.data for message in found} <= {message.data for message in FLIGHT}
    assert len(table(tmp_path / "H.csv")) >= 10


def test_an_input_that_is_cut_while_it_is_read(flight: list[Shot], tmp_path: Path) -> None:
    bag = write_mcap(tmp_path / "in.mcap", list(entries(flight * 40)))
    words = [sys.executable, "-m", "stab_ros", "stabilize", str(bag), str(tmp_path / "out.mcap"), "--no-image"]
    process = subprocess.Popen(words, stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    partial = tmp_path / "out.mcap.partial"
    while not partial.exists():  # reading begins
        time.sleep(0.01)
        assert process.poll() is None
    with bag.open("r+b") as file:
        file.truncate(bag.stat().st_size // 2)
    _, said = process.communicate(timeout=120)
    assert process.returncode == 0, said
    assert "its messages are lost" in said
    with open_bag(tmp_path / "out.mcap") as made:
        stamps = [message.log_time_ns for message in made.messages(["/cam/homography"])]
    assert 0 < len(stamps) < 40 * len(flight)
    assert np.all(np.diff(stamps) >= 0)
