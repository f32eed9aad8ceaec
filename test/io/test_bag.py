"""What our writer writes, in other libraries' readers; and what is left when writing breaks off."""

from __future__ import annotations

import random
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from bag_makers import FLIGHT, JAZZY, QOS, STRING, TOPICS, by_mcap, read, text_cdr, written
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import Reader as Reader2
from rosbags.typesys import get_types_from_msg

from stab_ros.core.errors import InputError, WorkError
from stab_ros.io.bag import BagWriter, Message, definition_of, open_bag, topic_of
from stab_ros.io.cdr import IMAGE


# what we write --------------------------------------------------------------------------------------------------------
def test_our_bag_in_mcaps_own_reader(tmp_path: Path) -> None:
    with written(tmp_path / "a.mcap").open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        profile, summary = reader.get_header().profile, reader.get_summary()
        found = [Message(channel.topic, message.log_time, message.publish_time, message.data)
                 for _, channel, message in reader.iter_messages()]
    assert profile == "ros2"
    assert found == FLIGHT
    assert summary is not None
    assert summary.statistics is not None
    assert summary.statistics.chunk_count == len(FLIGHT) // 4
    assert {channel.topic for channel in summary.channels.values()} == {topic.name for topic in TOPICS}
    assert summary.channels[1].metadata["offered_qos_profiles"] == QOS
    assert all(schema.encoding == "ros2msg" for schema in summary.schemas.values())


def test_our_bag_in_rosbags(tmp_path: Path) -> None:
    path = written(tmp_path / "a.mcap")
    with Reader2(path) as reader:
        found = [(connection.topic, time_ns, data) for connection, time_ns, data in reader.messages()]
    assert found == [(message.topic, message.log_time_ns, message.data) for message in FLIGHT]
    with AnyReader([path]) as parser:  # parses our definitions, where Reader2 only copies them
        notes: list[Any] = [
            parser.deserialize(data, STRING) for c, _, data in parser.messages() if c.msgtype == STRING]
        assert set(parser.topics) == {topic.name for topic in TOPICS}
    assert notes[2].data == "note 2 xx"


def test_our_bag_in_our_reader(tmp_path: Path) -> None:
    path = written(tmp_path / "a.mcap")
    found = read(path)
    assert found.messages == FLIGHT
    assert not found.warnings
    assert list(found.topics.values()) == [
        replace(topic, count=count) for topic, count in zip(TOPICS, (12, 12, 0), strict=True)]
    with open_bag(path) as reader:
        assert (reader.start_ns, reader.end_ns) == (FLIGHT[0].log_time_ns, FLIGHT[-1].log_time_ns)
    assert read(path, "/notes").messages == FLIGHT[1::2]
    assert read(path, "/silent").messages == read(path, "/unheard_of").messages == []


def test_bag_without_messages_keeps_its_topics(tmp_path: Path) -> None:
    path = written(tmp_path / "a.mcap", [])
    found = read(path)
    assert (found.messages, found.warnings) == ([], [])
    assert list(found.topics) == [topic.name for topic in TOPICS]
    with Reader2(path) as reader:
        assert len(reader.connections) == len(TOPICS)


def test_messages_come_in_the_order_of_their_log_time(tmp_path: Path) -> None:
    shuffled = random.Random(1).sample(FLIGHT, len(FLIGHT))
    assert read(written(tmp_path / "ours.mcap", shuffled)).messages == FLIGHT
    assert read(by_mcap(tmp_path / "mcap.mcap", shuffled)).messages == FLIGHT


def test_definitions_are_those_of_jazzy() -> None:
    types = get_types_from_msg(definition_of(IMAGE), IMAGE)
    assert types[IMAGE] == JAZZY.fielddefs[IMAGE]
    assert "std_msgs/msg/Header" in types
    with pytest.raises(InputError, match="'sensor_msgs/msg/Imag' is unknown"):
        definition_of("sensor_msgs/msg/Imag")


def test_topic_cannot_change_its_type(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "a.mcap") as writer:
        writer.add_topic(topic_of("/notes", STRING))
        writer.add_topic(topic_of("/notes", STRING))
        with pytest.raises(InputError, match="/notes is std_msgs"):
            writer.add_topic(topic_of("/notes", IMAGE))


@pytest.mark.parametrize("times", [(-1, 0), (0, -1), (2**64, 0)])
def test_times_beyond_64_bits_are_refused(tmp_path: Path, times: tuple[int, int]) -> None:
    with BagWriter(tmp_path / "a.mcap") as writer:
        writer.add_topic(TOPICS[1])
        with pytest.raises(InputError, match="64 bits"):
            writer.write("/notes", *times, text_cdr("late"))


# the name of what we write --------------------------------------------------------------------------------------------
def test_the_name_appears_with_the_whole_bag(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    with BagWriter(path):
        assert [found.name for found in tmp_path.iterdir()] == ["a.mcap.partial"]
    assert [found.name for found in tmp_path.iterdir()] == ["a.mcap"]


@pytest.mark.parametrize("taken", ["a.mcap", "a.mcap.partial"])
def test_nothing_is_overwritten_unless_asked_for(tmp_path: Path, taken: str) -> None:
    (tmp_path / taken).write_bytes(b"precious")
    with pytest.raises(InputError, match=f"{taken}: exists already"):
        BagWriter(tmp_path / "a.mcap")
    assert (tmp_path / taken).read_bytes() == b"precious"
    with BagWriter(tmp_path / "a.mcap", overwrite=True) as writer:
        writer.add_topic(TOPICS[1])
    assert list(read(tmp_path / "a.mcap").topics) == ["/notes"]


@pytest.mark.parametrize("name", ["no/such/folder/a.mcap", "file/a.mcap", ""])
def test_where_nothing_can_be_written(tmp_path: Path, name: str) -> None:
    (tmp_path / "file").touch()
    for path in (tmp_path / name, Path("/"), tmp_path / ("long" * 100)):
        with pytest.raises(InputError):
            BagWriter(path, overwrite=True)
    assert [found.name for found in tmp_path.iterdir()] == ["file"]


@pytest.mark.parametrize("error", [KeyboardInterrupt(), WorkError("the disk is gone"), ZeroDivisionError()])
def test_broken_work_leaves_a_readable_part(tmp_path: Path, error: BaseException) -> None:
    with pytest.raises(type(error)):
        write_until_it_breaks(tmp_path / "a.mcap", error)
    assert [found.name for found in tmp_path.iterdir()] == ["a.mcap.partial"]
    assert read(tmp_path / "a.mcap.partial")[:2] == ([FLIGHT[1]], [])


def write_until_it_breaks(path: Path, error: BaseException) -> None:
    with BagWriter(path) as writer:
        writer.add_topic(TOPICS[1])
        writer.write(*FLIGHT[1])
        raise error


def test_wrong_input_leaves_nothing(tmp_path: Path) -> None:
    with pytest.raises(InputError):
        write_until_it_breaks(tmp_path / "a.mcap", InputError("no such topic"))
    assert not list(tmp_path.iterdir())


HELPERS = Path(__file__).parents[1] / "helpers"
FILL_THE_DISK = """
import resource, sys
from pathlib import Path
from stab_ros.core.errors import WorkError
sys.path.insert(0, sys.argv[2])
from bag_makers import FLIGHT, TOPICS, BagWriter
resource.setrlimit(resource.RLIMIT_FSIZE, (40_000, 40_000))  # write() fails in the middle of a chunk
try:
    with BagWriter(Path(sys.argv[1])) as writer:
        for topic in TOPICS:
            writer.add_topic(topic)
        for number, message in enumerate(FLIGHT, start=1):
            writer.write(*message)
            if number % 4 == 0:
                writer.flush_chunk()
except WorkError as error:
    sys.exit(str(error))
"""


def test_full_disk_leaves_all_whole_chunks_to_any_reader(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    run = subprocess.run([sys.executable, "-c", FILL_THE_DISK, path, HELPERS],
                         capture_output=True, text=True, check=False)
    assert run.returncode == 1
    assert run.stderr.splitlines() == [f"{path}: File too large, what was written so far is in {path}.partial"]
    partial = (tmp_path / "a.mcap.partial").rename(tmp_path / "partial.mcap")
    found = read(partial)
    assert len(found.messages) >= 8
    assert found.messages == FLIGHT[: len(found.messages)]
    assert not found.warnings
    with Reader2(partial) as reader, partial.open("rb") as file:
        by_mcap_itself = list(make_reader(file, validate_crcs=True).iter_messages())
        assert reader.message_count == len(by_mcap_itself) == len(found.messages)


def test_full_disk_from_the_first_byte(tmp_path: Path) -> None:
    code = FILL_THE_DISK.replace("40_000", "5")
    run = subprocess.run([sys.executable, "-c", code, tmp_path / "a.mcap", HELPERS],
                         capture_output=True, text=True, check=False)
    assert (run.returncode, len(run.stderr.splitlines())) == (1, 1)
    assert not list(tmp_path.iterdir())


KILLED = """
import os, sys, time
from pathlib import Path
sys.path.insert(0, sys.argv[2])
from bag_makers import FLIGHT, TOPICS, BagWriter
with BagWriter(Path(sys.argv[1])) as writer:
    for topic in TOPICS:
        writer.add_topic(topic)
    for message in FLIGHT[:10]:
        writer.write(*message)
    writer.flush_chunk()
    for message in FLIGHT[10:]:
        writer.write(*message)
    print("ready", flush=True)
    time.sleep(60)
"""


@pytest.fixture
def killed(tmp_path: Path) -> Path:
    """What a recorder leaves that is killed after a chunk of ten messages was closed."""
    path = tmp_path / "killed.mcap"
    process = subprocess.Popen([sys.executable, "-c", KILLED, path, HELPERS], stdout=subprocess.PIPE)
    assert process.stdout is not None
    assert process.stdout.readline() == b"ready\n"
    process.send_signal(signal.SIGKILL)
    process.communicate()
    return path.with_name("killed.mcap.partial").rename(path)


def test_killed_recorder_loses_only_the_open_chunk(killed: Path) -> None:
    found = read(killed)
    assert found.messages == FLIGHT[:10]
    assert found.warnings == [f"{killed}: the index is missing, the recording was cut off at byte "
                              f"{killed.stat().st_size}, the whole file was scanned instead"]
    assert [topic.name for topic in found.topics.values()] == [topic.name for topic in TOPICS]
    assert found.topics["/notes"].count == 5


