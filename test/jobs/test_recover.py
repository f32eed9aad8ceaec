"""stab-ros recover: every closed chunk of a damaged recording, in a recording that any library reads."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

import pytest
from bag_makers import FLIGHT, TOPICS, by_mcap, read, written
from mcap.reader import make_reader
from rosbags.rosbag2 import Reader as Reader2

from stab_ros.core.errors import InputError
from stab_ros.io.bag import Message
from stab_ros.jobs.recover import recover

HELPERS = Path(__file__).parents[1] / "helpers"
RECORD_UNTIL_KILLED = """
import itertools, sys
from mcap.writer import Writer
sys.path.insert(0, sys.argv[2])
from bag_makers import FLIGHT, TOPICS
file = open(sys.argv[1], "wb")
writer = Writer(file, chunk_size=20_000)
writer.start(profile="ros2")
ids = {t.name: writer.register_channel(t.name, "cdr", writer.register_schema(
    t.msgtype, "ros2msg", t.definition.encode())) for t in TOPICS}
for number in itertools.count():
    message = FLIGHT[number % len(FLIGHT)]
    writer.add_message(ids[message.topic], number, message.data, number)
    if number == 200:
        file.flush()
        print("ready", flush=True)
"""


def contents(path: Path) -> list[Message]:
    """By mcap's own reader, CRCs checked."""
    with path.open("rb") as file:
        return [Message(channel.topic, message.log_time, message.publish_time, message.data)
                for _, channel, message in make_reader(file, validate_crcs=True).iter_messages()]


def test_recorder_killed_in_the_middle_of_its_work(tmp_path: Path) -> None:
    broken, fixed = tmp_path / "broken.mcap", tmp_path / "fixed.mcap"
    process = subprocess.Popen([sys.executable, "-c", RECORD_UNTIL_KILLED, broken, HELPERS],
                               stdout=subprocess.PIPE)
    assert process.stdout is not None
    assert process.stdout.readline() == b"ready\n"
    process.send_signal(signal.SIGKILL)
    process.communicate()
    done = recover(broken, fixed)
    found = contents(fixed)
    assert len(found) == done.messages > 150
    assert [message.log_time_ns for message in found] == list(range(len(found)))
    assert all(message.data == FLIGHT[number % len(FLIGHT)].data for number, message in enumerate(found))
    assert "the recording was cut off" in done.warnings[0]
    with Reader2(fixed) as reader:
        assert {connection.topic for connection in reader.connections} == {topic.name for topic in TOPICS}


def test_chunk_with_a_wrong_crc_is_left_out_and_named(tmp_path: Path) -> None:
    broken, fixed = written(tmp_path / "broken.mcap"), tmp_path / "fixed.mcap"
    content = bytearray(broken.read_bytes())
    content[content.index(FLIGHT[5].data) + 5] ^= 1
    broken.write_bytes(content)
    done = recover(broken, fixed)
    assert contents(fixed) == FLIGHT[:4] + FLIGHT[8:]
    assert done.messages == len(FLIGHT) - 4
    (warning,) = done.warnings
    assert warning.startswith(f"{broken}: the part at byte ")
    assert warning.endswith("has a wrong CRC, its messages are lost")


def test_whole_recording_is_copied(tmp_path: Path) -> None:
    whole, copy = by_mcap(tmp_path / "whole.mcap"), tmp_path / "copy.mcap"
    done = recover(whole, copy)
    assert (done.messages, done.topics, done.warnings) == (len(FLIGHT), len(TOPICS), ())
    assert contents(copy) == contents(whole) == FLIGHT
    assert read(copy).topics["/cam/image_raw"] == read(whole).topics["/cam/image_raw"]


def test_recovering_twice_gives_the_same(tmp_path: Path) -> None:
    broken = by_mcap(tmp_path / "broken.mcap")
    broken.write_bytes(broken.read_bytes()[:30_000])
    recover(broken, tmp_path / "a.mcap")
    recover(tmp_path / "a.mcap", tmp_path / "b.mcap")
    assert (tmp_path / "a.mcap").read_bytes() == (tmp_path / "b.mcap").read_bytes()


@pytest.mark.parametrize("content", [b"", b"no recording", b"\x89MCAP0\r\n", b"\x89MCAP0\r\n" + bytes(100)])
def test_nothing_to_recover(tmp_path: Path, content: bytes) -> None:
    broken = tmp_path / "broken.mcap"
    broken.write_bytes(content)
    with pytest.raises(InputError, match=r"broken\.mcap: .* must ") as caught:
        recover(broken, tmp_path / "fixed.mcap")
    assert len(str(caught.value).splitlines()) == 1
    assert list(tmp_path.iterdir()) == [broken]


def test_output_is_not_overwritten_and_never_the_input(tmp_path: Path) -> None:
    broken, other = by_mcap(tmp_path / "broken.mcap"), tmp_path / "other.mcap"
    content = broken.read_bytes()
    other.write_bytes(b"precious")
    with pytest.raises(InputError, match="exists already"):
        recover(broken, other)
    with pytest.raises(InputError, match="another file"):
        recover(broken, broken, overwrite=True)
    assert (broken.read_bytes(), other.read_bytes()) == (content, b"precious")
    recover(broken, other, overwrite=True)
    assert contents(other) == FLIGHT
