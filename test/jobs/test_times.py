"""Recordings whose header stamps are wrong: it is said, and the log times can take their place."""

from __future__ import annotations

import json
from collections.abc import Collection, Sequence
from dataclasses import replace
from pathlib import Path

import pytest
from conftest import Command
from recordings import IMAGE_TOPIC, LOG_DELAY_NS, Entry, entries, image, write_mcap

from stab_ros.io.bag import BagWriter, open_bag
from stab_ros.io.cdr import read_stamp
from stab_ros.io.homographies import read_homographies
from stab_ros.jobs.log_stamps import LogStamps
from stab_ros.synthetic.flight import Shot

WORDS = "header stamps say 0.2 ms between frames, the log 200 ms (factor 1000): perhaps microseconds in nanosec"


def in_microseconds(stamp_ns: int) -> int:
    return stamp_ns // 10**9 * 10**9 + stamp_ns % 10**9 // 1000


@pytest.fixture
def wrong(flight: list[Shot], tmp_path: Path) -> Path:
    """A flight whose driver has put microseconds into nanosec."""
    shots = [replace(shot, stamp_ns=in_microseconds(shot.stamp_ns)) for shot in flight]
    return write_mcap(tmp_path / "wrong.mcap", [
        Entry(IMAGE_TOPIC, "sensor_msgs/msg/Image", shot.stamp_ns + LOG_DELAY_NS, image(made))
        for shot, made in zip(flight, shots, strict=True)])


def logged(flight: list[Shot]) -> list[int]:
    return [shot.stamp_ns + LOG_DELAY_NS for shot in flight]


def stamps_in(bag: Path, topic: str) -> list[int]:
    with open_bag(bag) as reader:
        return [read_stamp(message.data) for message in reader.messages([topic])]


def test_wrong_stamps_are_named_by_every_command(wrong: Path, command: Command, tmp_path: Path) -> None:
    out = tmp_path / "out.mcap"
    for words in (("stabilize", wrong, out, "-p", "start_s:=0.0"), ("evaluate", out), ("info", wrong),
                  ("compare", wrong, "--methods", "direct", "--limit", 9)):
        done = command(*words)
        assert done.returncode == 0
        (line,) = done.stderr.splitlines()
        assert WORDS in line
        assert ("--time log" in line) == (words[0] != "info")


def test_log_times_take_the_place_of_stamps_in_all_that_is_written(
        wrong: Path, flight: list[Shot], command: Command, tmp_path: Path) -> None:
    out, table = tmp_path / "out.mcap", tmp_path / "H.csv"
    done = command("stabilize", wrong, out, "--homographies", table, "--keep-raw", "--time", "log")
    assert (done.returncode, done.stderr) == (0, "")
    assert [row.stamp_ns for row in read_homographies(table)] == logged(flight)
    for name in ("image_raw", "homography", "image_stabilized", "track"):
        assert stamps_in(out, f"/cam/{name}") == logged(flight), name
    with open_bag(wrong) as before, open_bag(out) as after:  # all but the stamp stays as it was
        for one, other in zip(before.messages(), after.messages([IMAGE_TOPIC]), strict=True):
            assert (one.data[:4], one.data[12:]) == (other.data[:4], other.data[12:])


@pytest.mark.thorough
def test_velocities_go_by_the_log(wrong: Path, flight: list[Shot], command: Command, tmp_path: Path) -> None:
    out, right = tmp_path / "out.mcap", write_mcap(tmp_path / "right.mcap", list(entries(flight)))
    median: dict[str, float] = {}
    for name, bag, options in (("wrong", wrong, ()), ("by log", wrong, ("--time", "log")), ("right", right, ())):
        assert command("stabilize", bag, out, "--force").returncode == 0  # by the header stamps, whatever they are
        figures = tmp_path / "e.json"
        done = command("evaluate", out, "-p", "gsd_m:=0.06", "--json", figures, "--force", *options,
                       "--report", tmp_path / "report")
        assert done.returncode == 0
        topic = json.loads(figures.read_text())["topics"]["/cam/image_stabilized"]
        median[name] = topic["velocity_error_m_s"]["median"]
        assert topic["velocity_error_m_s"]["count"] == 9
    assert median["by log"] == pytest.approx(median["right"], rel=0.05)
    assert median["wrong"] > 500 * median["right"]


def test_a_video_has_no_log_times(recordings: dict[str, Path], command: Command, tmp_path: Path) -> None:
    for words in (("stabilize", recordings["video"], tmp_path / "out.mcap"), ("evaluate", recordings["folder"]),
                  ("compare", recordings["video"])):
        done = command(*words, "--time", "log")
        assert done.returncode == 2
        (line,) = done.stderr.splitlines()
        assert "has no log times, --time log is for bags" in line
    assert not (tmp_path / "out.mcap").exists()


def test_stamps_that_repeat_take_the_log_times_in_order() -> None:
    stamps = LogStamps([(1, 10), (1, 11), (2, 20)])
    assert [stamps.next_of(stamp, 99) for stamp in (1, 1, 1, 2, 3)] == [10, 11, 11, 20, 99]
    assert stamps.first_of(2, 99) == 20


def logged_in(order: Sequence[int], bag: Path, path: Path, topics: Collection[str]) -> Path:
    """`bag` with the k-th message of each of the topics logged as number order[k], the other topics as they were."""
    with open_bag(bag) as reader, BagWriter(path) as writer:
        messages = list(reader.messages())
        for topic in reader.topics.values():
            writer.add_topic(topic)
        for name in reader.topics:
            mine = [one for one in messages if one.topic == name]
            times = [one.log_time_ns for one in mine]
            for number, message in enumerate(mine):
                time_ns = times[order[number]] if name in topics else times[number]
                writer.write(name, time_ns, message.publish_time_ns, message.data)
    return path


SWAPPED = (1, 0, 3, 2, 5, 4, 7, 6, 9, 8)


def test_images_that_are_logged_out_of_order_are_taken_by_their_stamps(
        recordings: dict[str, Path], flight: list[Shot], command: Command, tmp_path: Path) -> None:
    found = {}
    swapped = logged_in(SWAPPED, recordings["mcap"], tmp_path / "swapped.mcap", [IMAGE_TOPIC])
    for name, bag in (("right", recordings["mcap"]), ("swapped", swapped)):
        table = tmp_path / f"{name}.csv"
        done = command("stabilize", bag, tmp_path / f"{name}_out.mcap", "--homographies", table)
        assert done.returncode == 0
        found[name] = table.read_text(), done.stderr
    assert found["swapped"][0] == found["right"][0]  # the same rows, in the order of the stamps
    (line,) = found["swapped"][1].splitlines()
    assert f"5 images of {IMAGE_TOPIC} are logged out of order, all are taken in the order of their header" in line
    assert not found["right"][1]
    table = tmp_path / "log.csv"
    done = command("stabilize", swapped, tmp_path / "log.mcap", "--homographies", table, "--time", "log")
    assert [row.stamp_ns for row in read_homographies(table)] == logged(flight)


@pytest.mark.parametrize("topics", [("/cam/homography",), ("/cam/image_stabilized",),
                                    ("/cam/homography", "/cam/image_stabilized")])
def test_pairs_that_are_logged_out_of_order_are_all_measured(
        topics: Sequence[str], recordings: dict[str, Path], command: Command, tmp_path: Path) -> None:
    out = tmp_path / "out.mcap"
    assert command("stabilize", recordings["mcap"], out).returncode == 0
    orders = {"right": range(10), "shuffled": (2, 0, 1, 5, 3, 4, 7, 6, 9, 8)}
    rows = {}
    for name, order in orders.items():
        bag = logged_in(order, out, tmp_path / f"{name}.mcap", topics)
        assert command("evaluate", bag, "--csv", tmp_path / f"{name}.csv").returncode == 0
        rows[name] = (tmp_path / f"{name}.csv").read_text()
    assert rows["shuffled"] == rows["right"]
