"""The commands besides stabilize, and how the process behaves: exit codes, terminals, signals, full disks."""

from __future__ import annotations

import os
import pty
import resource
import shlex
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from conftest import Command
from mcap.reader import make_reader
from mcap.records import Message
from mcap.stream_reader import StreamReader
from recordings import IMAGE_TOPIC, OTHER_TOPIC, RECORDERS, Entry, entries, to_cdr, write_mcap
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

import stab_ros
from stab_ros.cli.console import progress_bar
from stab_ros.synthetic.flight import Shot

JAZZY = get_typestore(Stores.ROS2_JAZZY)
STAB_ROS = (sys.executable, "-m", "stab_ros")


def contents(path: Path) -> list[tuple[str, int, bytes]]:
    """Topic, log time and bytes of every message, as rosbags reads them."""
    with AnyReader([path], default_typestore=JAZZY) as reader:
        return [(connection.topic, log_time_ns, data) for connection, log_time_ns, data in reader.messages()]


def test_help_lists_the_commands(executable: Command) -> None:
    done = executable("--help")
    assert done.returncode == 0
    for name in ("stabilize", "convert", "play", "record", "recover", "info"):
        assert name in done.stdout
        assert executable(name, "--help").returncode == 0
    assert executable("--version").stdout == f"stab-ros {stab_ros.__version__}\n"


@pytest.mark.parametrize("kind", list(RECORDERS))
def test_info_tells_what_an_input_holds(kind: str, recordings: dict[str, Path], command: Command) -> None:
    done = command("info", recordings[kind])
    assert (done.returncode, done.stderr) == (0, "")
    assert "480x270" in done.stdout
    if kind in ("folder", "video"):
        assert "10 frames, 25 frames/s" in done.stdout
    else:
        assert "20 messages" in done.stdout
        lines = {line.split()[0]: line.split()[1:] for line in done.stdout.splitlines()[1:3]}
        assert lines == {IMAGE_TOPIC: ["sensor_msgs/msg/Image", "10"], OTHER_TOPIC: ["std_msgs/msg/Float64", "10"]}


@pytest.mark.parametrize("kind", ["mcap", "rosbag2_mcap", "rosbag2_sqlite3", "rosbag1"])
def test_a_bag_is_converted_byte_for_byte(
    kind: str, flight: list[Shot], recordings: dict[str, Path], command: Command, tmp_path: Path
) -> None:
    done = command("convert", recordings[kind], tmp_path / "out.mcap")
    assert (done.returncode, done.stderr) == (0, "")
    assert "20 messages" in done.stdout
    assert contents(tmp_path / "out.mcap") == [(e.topic, e.log_time_ns, to_cdr(e)) for e in entries(flight)]


def test_one_topic_of_a_bag_is_converted(recordings: dict[str, Path], command: Command, tmp_path: Path) -> None:
    done = command("convert", recordings["mcap"], tmp_path / "out.mcap", "--topic", OTHER_TOPIC)
    assert done.returncode == 0
    assert {topic for topic, _, _ in contents(tmp_path / "out.mcap")} == {OTHER_TOPIC}


@pytest.mark.parametrize("kind", ["folder", "video"])
def test_pictures_are_converted_to_messages(
    kind: str, flight: list[Shot], recordings: dict[str, Path], command: Command, tmp_path: Path
) -> None:
    options = ("--topic", "/drone/image", "--fps", 10, "--limit", 7)
    done = command("convert", recordings[kind], tmp_path / "out.mcap", *options)
    assert done.returncode == 0
    assert done.stderr.count("\n") == (kind == "video")  # whose own times say another rate
    assert "its times say 25 frames/s, and 10 are taken" in done.stderr or kind == "folder"
    found = contents(tmp_path / "out.mcap")
    assert [(topic, log_time_ns) for topic, log_time_ns, _ in found] == [
        ("/drone/image", 10**9 + number * 10**8) for number in range(7)]
    message: Any = JAZZY.deserialize_cdr(found[4][2], "sensor_msgs/msg/Image")
    assert message.encoding == ("mono8" if kind == "folder" else "bgr8")
    pixels = message.data.reshape(270, 480, -1)[:, :, 0]
    np.testing.assert_array_equal(pixels, flight[4].image)


def test_a_broken_recording_is_worked_on_with_a_warning_and_recovered(
    flight: list[Shot], command: Command, tmp_path: Path
) -> None:
    whole = write_mcap(tmp_path / "whole.mcap", list(entries(flight)) * 4).read_bytes()
    broken = tmp_path / "broken.mcap"
    broken.write_bytes(whole[: len(whole) * 2 // 3])
    stabilised = command("stabilize", broken, tmp_path / "out.mcap", "--no-image")
    recovered = command("recover", broken, tmp_path / "fixed.mcap")
    for done in (stabilised, recovered, command("info", broken)):
        assert done.returncode == 0, done.stderr
        assert "broken.mcap" in done.stderr
        assert all(line.startswith("stab-ros: warning: ") for line in done.stderr.splitlines())
    saved = len(contents(tmp_path / "fixed.mcap"))
    assert f"{saved} messages on 2 topics" in recovered.stdout
    assert 0 < saved < 80
    assert command("recover", broken, tmp_path / "fixed.mcap").returncode == 2
    assert command("recover", broken, tmp_path / "fixed.mcap", "--force").returncode == 0


@pytest.mark.parametrize("words", [["play", "x.mcap"], ["record", "x.mcap", "/topic"]])
def test_without_ros_the_live_commands_say_what_to_install(words: list[str], tmp_path: Path) -> None:
    program = f"import sys; sys.modules['rclpy'] = None; from stab_ros.cli import main; sys.exit(main({words}))"
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=tmp_path, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 2
    assert len(done.stderr.splitlines()) == 1
    assert "rclpy" in done.stderr
    assert list(tmp_path.iterdir()) == []


def test_progress_is_shown_on_a_terminal_only(recordings: dict[str, Path], tmp_path: Path) -> None:
    master, slave = pty.openpty()
    words = [*STAB_ROS, "stabilize", str(recordings["mcap"]), str(tmp_path / "out.mcap")]
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=slave) as process:
        os.close(slave)
        shown = read_all(master)
    assert process.returncode == 0
    assert "frames/s" in shown
    assert "/10" in shown


@pytest.mark.parametrize("total", [None, 3])
def test_progress_is_counted_with_or_without_a_known_total(total: int | None) -> None:
    with progress_bar("frames") as show:
        for done in (1, 2, 3):
            show(done, total)


def read_all(terminal: int) -> str:
    """Everything that is written to a terminal until its other side is closed."""
    text = b""
    while True:
        try:
            part = os.read(terminal, 4096)
        except OSError:  # how Linux reports the end of a terminal
            part = b""
        if not part:
            os.close(terminal)
            return text.decode()
        text += part


def long_bag(folder: Path, shots: Sequence[Shot], times: int) -> Path:
    """The flight again and again."""
    frames = list(entries(shots))
    again = [Entry(e.topic, e.msgtype, e.log_time_ns + n * 4 * 10**9, e.message) for n in range(times) for e in frames]
    return write_mcap(folder / "long.mcap", again)


def test_an_interrupt_ends_with_130_and_leaves_a_readable_part(flight: list[Shot], tmp_path: Path) -> None:
    words = [*STAB_ROS, "stabilize", str(long_bag(tmp_path, flight, times=60)), "out.mcap", "--homographies", "H.csv"]
    partial = tmp_path / "out.mcap.partial"
    with subprocess.Popen(words, cwd=tmp_path, stderr=subprocess.PIPE, text=True) as process:
        while process.poll() is None and not (partial.exists() and partial.stat().st_size > 1_000_000):
            time.sleep(0.01)
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=60)
    assert process.returncode == 130
    assert len(err.splitlines()) == 1
    assert "interrupted" in err
    assert sorted(path.name for path in tmp_path.iterdir()) == ["H.csv.partial", "long.mcap", "out.mcap.partial"]
    with partial.open("rb") as file:
        assert sum(1 for _ in make_reader(file).iter_messages(topics=["/cam/homography"])) > 0


def run_on_a_full_disk(*words: object, cwd: Path, room: int) -> subprocess.CompletedProcess[str]:
    """A file takes no more than `room` bytes: writing more fails with an error of the operating system."""

    def limit_file_size() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (room, room))

    return subprocess.run([*STAB_ROS, *map(str, words)], cwd=cwd, capture_output=True, text=True, timeout=60,
                          check=False, preexec_fn=limit_file_size)


@pytest.mark.parametrize("name", ["stabilize", "convert"])
def test_a_full_disk_ends_with_1_and_leaves_the_readable_part(
    name: str, flight: list[Shot], command: Command, tmp_path: Path
) -> None:
    long_bag(tmp_path, flight, times=4)
    done = run_on_a_full_disk(name, "long.mcap", "out.mcap", cwd=tmp_path, room=3_000_000)
    assert done.returncode == 1, done.stderr
    assert len(done.stderr.splitlines()) == 1, done.stderr
    assert "out.mcap.partial" in done.stderr
    assert sorted(path.name for path in tmp_path.iterdir()) == ["long.mcap", "out.mcap.partial"]
    with (tmp_path / "out.mcap.partial").open("rb") as file:
        assert sum(isinstance(record, Message) for record in StreamReader(file).records) > 10
    assert command("info", tmp_path / "out.mcap.partial").returncode == 0
    assert command("recover", tmp_path / "out.mcap.partial", tmp_path / "fixed.mcap").returncode == 0


@pytest.mark.thorough
def test_a_full_disk_is_noticed_by_the_video_too(tmp_path: Path) -> None:
    noise = np.random.default_rng(1)
    (tmp_path / "frames").mkdir()
    for number in range(12):
        picture = noise.integers(0, 256, (480, 640, 3), np.uint8)
        cv2.imwrite(str(tmp_path / "frames" / f"{number:02}.png"), picture)
    words = ("stabilize", "frames", "out.mcap", "--no-image", "--video", "V.mp4", "-p", "on_lost:=pass")
    done = run_on_a_full_disk(*words, cwd=tmp_path, room=700_000)
    assert done.returncode == 1, done.stderr
    assert "V.partial.mp4" in done.stderr
    assert len(done.stderr.splitlines()) == 1
    assert not (tmp_path / "V.mp4").exists()
    assert not (tmp_path / "out.mcap").exists()


def test_a_reader_that_goes_away_is_no_error_to_tell(recordings: dict[str, Path]) -> None:
    words = [*STAB_ROS, "info", str(recordings["mcap"])]
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        process.stdout.close()
        assert process.stderr is not None
        assert process.stderr.read() == ""
    assert process.returncode == 1


@pytest.mark.parametrize(("output", "code", "says"), [
    ("> /dev/full", 1, "stab-ros: standard output cannot be written (No space left on device)"), (">&-", 0, "")])
def test_output_that_goes_nowhere_leaves_no_traceback(
    output: str, code: int, says: str, recordings: dict[str, Path]
) -> None:
    words = " ".join(map(shlex.quote, [*STAB_ROS, "info", str(recordings["mcap"])]))
    done = subprocess.run(["bash", "-c", f"{words} {output}"], stderr=subprocess.PIPE, text=True, check=False)
    assert done.returncode == code
    assert done.stderr.startswith(says)
    assert done.stderr.count("\n") == bool(says)


def test_an_output_that_is_a_link_is_written_to_where_it_leads(
    recordings: dict[str, Path], command: Command, tmp_path: Path
) -> None:
    (tmp_path / "disk").mkdir()
    names = {"out.mcap": "--force", "H.csv": "--homographies"}
    for name in names:
        (tmp_path / name).symlink_to(tmp_path / "disk" / name)
    done = command("stabilize", recordings["mcap"], tmp_path / "out.mcap", "--homographies", tmp_path / "H.csv",
                   "--force", "--limit", 2)
    assert (done.returncode, done.stderr) == (0, "")
    for name in names:
        assert (tmp_path / name).is_symlink()
        assert (tmp_path / "disk" / name).stat().st_size > 0


@pytest.mark.thorough
def test_names_of_any_bytes(recordings: dict[str, Path], command: Command, tmp_path: Path) -> None:
    source = tmp_path / "DJI_\udce9.mp4"  # as a camera or an old archive names it
    source.write_bytes(recordings["video"].read_bytes())
    output = tmp_path / "stabilised_\udce9.mcap"
    assert command("info", source).returncode == 0
    assert command("stabilize", source, output, "--limit", 2).returncode == 0
    assert command("evaluate", output, "--report", tmp_path / "report").returncode == 0
    done = command("stabilize", source, output, "--force", "--video", tmp_path / "\udce9.mp4")
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert "must be UTF-8" in done.stderr
