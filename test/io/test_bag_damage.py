"""Recordings as they really get damaged: all that is readable is read, and the loss is said; or one line."""

from __future__ import annotations

import os
import random
import re
import shutil
import sqlite3
import subprocess
from collections.abc import Iterator
from contextlib import closing
from itertools import accumulate
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zstandard
from bag_makers import (
    FLIGHT,
    JAZZY,
    METADATA,
    NOETIC,
    START_NS,
    STRING,
    Read,
    by_mcap,
    flight,
    read,
    ros1_messages,
    without_publish_time,
)
from mcap.data_stream import RecordBuilder
from mcap.reader import make_reader
from mcap.records import Channel, Chunk, Schema
from mcap.records import Message as McapMessage
from mcap.writer import CompressionType
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import Writer as Writer2

from stab_ros.core.errors import InputError
from stab_ros.io.bag import Message
from stab_ros.io.cdr import IMAGE, Header
from stab_ros.io.image_message import image_cdr
from stab_ros.io.mcap_records import MAGIC
from stab_ros.io.source import Kind, kind_of, open_source
from stab_ros.jobs.recover import recover


# damage ---------------------------------------------------------------------------------------------------------------
def refusal(path: Path) -> str:
    with pytest.raises(InputError) as caught:
        read(path)
    return str(caught.value)


@pytest.mark.parametrize("name", ["a.mcap", "a.bag", "a.db3", "a.txt", "folder"])
def test_missing_recordings(tmp_path: Path, name: str) -> None:
    assert refusal(tmp_path / name).startswith(f"{tmp_path / name}: no such file")


@pytest.mark.parametrize("content", [b"", b"\x89MCA", b"This is only a text.\n" * 50, bytes(5000), b"\x89MCAP1\r\n"])
@pytest.mark.parametrize("name", ["a.mcap", "a.bag", "a.db3", "a.txt"])
def test_files_that_are_no_recordings(tmp_path: Path, name: str, content: bytes) -> None:
    (tmp_path / name).write_bytes(content)
    message = refusal(tmp_path / name)
    assert message.startswith(f"{tmp_path / name}: ")
    assert "must be" in message or "must begin" in message
    assert len(message.splitlines()) == 1


def test_things_that_are_no_files(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.mcap")
    (tmp_path / "folder.mcap").mkdir()
    for path in tmp_path.iterdir():
        assert len(refusal(path).splitlines()) == 1


@pytest.mark.parametrize("metadata", ["", "text", "rosbag2_bagfile_information: {}", METADATA,
                                      METADATA.replace("''", "file"), METADATA.replace("''", "[1]")])
def test_folders_that_are_no_recordings(tmp_path: Path, metadata: str) -> None:
    (tmp_path / "metadata.yaml").write_text(metadata)
    assert len(refusal(tmp_path).splitlines()) == 1


def outcome(path: Path) -> Read | str:
    """What is read, or the one line that says why not; any other error fails the test."""
    try:
        return read(path)
    except InputError as error:
        return str(error)


def assert_honest(found: Read | str, expected: list[Message]) -> None:
    """Nothing that was not recorded, in order, and a warning for what is lost."""
    if isinstance(found, str):
        assert len(found.splitlines()) == 1
        return
    remaining: Iterator[Message] = iter(expected)
    assert all(message in remaining for message in found.messages)
    assert found.warnings or len(found.messages) == len(expected)
    assert all(len(line.splitlines()) == 1 for line in found.warnings)


COMPRESSIONS = [CompressionType.NONE, CompressionType.LZ4, CompressionType.ZSTD]


@pytest.mark.parametrize("compression", COMPRESSIONS)
def test_cut_off_anywhere(tmp_path: Path, compression: CompressionType) -> None:
    path = by_mcap(tmp_path / "whole.mcap", compression=compression)
    content = path.read_bytes()
    ends = [0]
    for length in [*range(60), *range(60, len(content), 997), *range(len(content) - 60, len(content))]:
        path.write_bytes(content[:length])
        found = outcome(path)
        assert_honest(found, FLIGHT)
        if not isinstance(found, str):
            assert found.messages == FLIGHT[: len(found.messages)]
            ends.append(len(found.messages))
    assert ends == sorted(ends)  # the more is left of the file, the more is read
    assert ends[-1] == len(FLIGHT)


LONG = flight(150)  # of 0.75 MB, some blocks of any compression


@pytest.mark.parametrize("compression", COMPRESSIONS)
def test_cut_off_within_its_only_chunk(tmp_path: Path, compression: CompressionType) -> None:
    path = by_mcap(tmp_path / "whole.mcap", LONG, compression=compression, chunk_size=2**22)
    content = path.read_bytes()
    block = 0 if compression is CompressionType.NONE else 2**17  # noise does not shrink
    for length in (len(content) * 6 // 10, len(content) * 9 // 10):
        path.write_bytes(content[:length])
        ends = [content.find(message.data) + len(message.data) for message in LONG] if block == 0 else list(
            accumulate(len(message.data) + 31 for message in LONG))
        before = sum(0 < end <= length - block for end in ends)
        found = read(path)
        assert before > 10
        assert len(found.messages) == before if block == 0 else before - 5 < len(found.messages) < len(LONG)
        assert found.messages == LONG[: len(found.messages)]
        assert f"the recording was cut off at byte {length}" in found.warnings[0]
        assert f"is cut off, its first {len(found.messages)} messages are read" in found.warnings[1]
        recover(path, tmp_path / "fixed.mcap", overwrite=True)
        assert read(tmp_path / "fixed.mcap")[:2] == (found.messages, [])


@pytest.mark.parametrize(("length", "said"), [
    (100, "holds no images"), (3000, "not one image of /cam/image_raw can be decoded")])
def test_cut_off_before_the_first_image(tmp_path: Path, length: int, said: str) -> None:
    path = by_mcap(tmp_path / "whole.mcap", compression=CompressionType.NONE)
    path.write_bytes(path.read_bytes()[:length])
    with pytest.raises(InputError) as caught, open_source(path) as source:
        list(source.items())
    message = str(caught.value)
    assert message.startswith(f"{path}: {said}")
    assert f"the recording was cut off at byte {length}" in message
    assert len(message.splitlines()) == 1


def test_a_large_chunk_that_is_compressed(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    sent = [Message("/cam/image_raw", START_NS + number, START_NS + number, image_cdr(
        rng.integers(0, 16, (3000, 4000), np.uint8), "mono8", Header(START_NS, "cam"))) for number in range(4)]
    path = by_mcap(tmp_path / "large.mcap", sent, chunk_size=2**26, compression=CompressionType.ZSTD)
    assert 2**24 < path.stat().st_size < 2**25
    assert read(path)[:2] == (sent, [])
    path.write_bytes(path.read_bytes()[: 2**24 + 2**20])
    assert read(path).messages == sent[:2]


def largest_chunk(path: Path) -> int:
    """Messages in it."""
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    assert len(summary.chunk_indexes) >= 3
    return max(sum(chunk.message_start_time <= message.log_time_ns <= chunk.message_end_time for message in FLIGHT)
               for chunk in summary.chunk_indexes)


@pytest.mark.parametrize("compression", COMPRESSIONS)
def test_one_flipped_bit_costs_one_chunk_at_most(tmp_path: Path, compression: CompressionType) -> None:
    path = by_mcap(tmp_path / "whole.mcap", compression=compression)
    content = path.read_bytes()
    rng = random.Random(5)
    largest = largest_chunk(path)
    index = range(len(content) - 3000, len(content))
    for position in [*range(40), *rng.sample(range(len(content)), 150), *rng.sample(index, 100)]:
        damaged = bytearray(content)
        damaged[position] ^= 1 << rng.randrange(8)
        path.write_bytes(damaged)
        found = outcome(path)
        assert_honest(found, FLIGHT)
        if position >= len(MAGIC):
            assert isinstance(found, Read)
            assert len(found.messages) >= len(FLIGHT) - largest


@pytest.mark.parametrize("options", [{"use_chunking": False}, {"enable_crcs": False}], ids=str)
def test_damage_without_crcs_raises_nothing_else(tmp_path: Path, options: dict[str, Any]) -> None:
    path = by_mcap(tmp_path / "whole.mcap", **options)
    content = path.read_bytes()
    rng = random.Random(6)
    for _ in range(150):
        damaged = bytearray(content[: rng.choice([len(content), rng.randrange(len(content))])])
        for _ in range(3):
            if damaged:
                damaged[rng.randrange(len(damaged))] = rng.randrange(256)
        path.write_bytes(damaged)
        found = outcome(path)
        assert isinstance(found, str) or all(len(line.splitlines()) == 1 for line in found.warnings)


@pytest.mark.parametrize("suffix", [".db3", ".bag"])
def test_damaged_sqlite3_and_ros1(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"a{suffix}"
    if suffix == ".bag":
        with Writer1(path) as writer1:
            for topic, msgtype, message in ros1_messages():
                connection1 = writer1.add_connection(topic, msgtype, typestore=NOETIC)
                for number in range(10):
                    writer1.write(connection1, START_NS + number, NOETIC.serialize_ros1(message, msgtype))
    else:
        with Writer2(tmp_path / "bag", version=9) as writer2:
            connection2 = writer2.add_connection("/notes", STRING, typestore=JAZZY)
            for message2 in FLIGHT[1::2]:
                writer2.write(connection2, message2.log_time_ns, message2.data)
        (tmp_path / "bag" / "bag.db3").rename(path)
    content = path.read_bytes()
    rng = random.Random(7)
    for number in range(150):
        damaged = bytearray(content)
        for _ in range(number % 3 + 1):
            damaged[rng.randrange(len(damaged))] = rng.randrange(256)
        path.write_bytes(damaged if number % 2 else damaged[: rng.randrange(len(damaged))])
        found = outcome(path)
        assert len(found.splitlines()) == 1 if isinstance(found, str) else all(
            len(line.splitlines()) == 1 for line in found.warnings)


def ros1_bag(path: Path, count: int = 300) -> Path:
    with Writer1(path) as writer:
        for topic, msgtype, message in ros1_messages():
            connection = writer.add_connection(topic, msgtype, typestore=NOETIC)
            for number in range(count):
                writer.write(connection, START_NS + number, NOETIC.serialize_ros1(message, msgtype))
    return path


def sqlite3_bag(folder: Path) -> Path:
    with Writer2(folder, version=9) as writer:
        connection = writer.add_connection("/cam/image_raw", IMAGE, typestore=JAZZY)
        for message in LONG[::2]:
            writer.write(connection, message.log_time_ns, message.data)
    return folder / f"{folder.name}.db3"


@pytest.mark.parametrize("name", ["a b.bag", "a b.bag.active"])
def test_a_ros1_bag_that_was_not_closed(tmp_path: Path, name: str) -> None:
    path = ros1_bag(tmp_path / name)
    content = path.read_bytes()
    assert kind_of(path) is Kind.BAG
    assert len(read(path).messages) == 900
    unindexed = re.sub(rb"index_pos=.{8}", b"index_pos=" + bytes(8), content, count=1, flags=re.DOTALL)
    assert unindexed != content
    for left in (content[: len(content) // 2], content[:-200], unindexed):
        path.write_bytes(left)
        line = refusal(path)
        assert line.startswith(f"{path}: cannot be read (Bag ")
        assert "it is cut off or was not closed; `rosbag reindex 'a b.bag" in line
        assert "('" not in line
        assert len(line.splitlines()) == 1
        with pytest.raises(InputError, match=r"is a ROS 1 bag, not an MCAP file; if it is cut off .* `rosbag "):
            recover(path, tmp_path / "fixed.mcap")


def test_a_damaged_sqlite3_file(tmp_path: Path) -> None:
    path = sqlite3_bag(tmp_path / "bag")
    content = path.read_bytes()
    assert read(path).messages == without_publish_time(LONG[::2])
    for length in (len(content) // 10, len(content) // 2, len(content) // 2 // 4096 * 4096):
        path.write_bytes(content[:length])
        line = refusal(path)
        assert line.startswith(f"{path}: cannot be read (")
        assert 'it is damaged or cut off; `sqlite3 bag.db3 ".recover" | sqlite3 whole.db3` saves' in line
        assert len(line.splitlines()) == 1
        with pytest.raises(InputError, match="is a recording in sqlite3, not an MCAP file; if it is damaged"):
            recover(path, tmp_path / "fixed.mcap")
    path.write_bytes(content[:-100])
    (warning,) = read(path).warnings
    assert "what follows is lost; `sqlite3 bag.db3" in warning


@pytest.mark.parametrize("statement", [
    "drop table topics", "drop table messages", "alter table topics rename column type to kind",
    "update message_definitions set encoding = 'odd'"])
def test_an_intact_sqlite3_file_that_is_no_recording(tmp_path: Path, statement: str) -> None:
    path = sqlite3_bag(tmp_path / "bag")
    with closing(sqlite3.connect(path)) as database:
        database.execute(statement)
        database.commit()
    line = refusal(path)
    assert line.startswith(f"{path}: cannot be read (")
    assert line.endswith("), it must be a whole recording")


@pytest.mark.parametrize(("suffix", "name"), [(".bag", "a ROS 1 bag"), (".db3", "a recording in sqlite3")])
def test_an_intact_recording_with_the_name_of_another_format(tmp_path: Path, suffix: str, name: str) -> None:
    whole = ros1_bag(tmp_path / "b.bag", 10) if suffix == ".bag" else sqlite3_bag(tmp_path / "b")
    sent = read(whole).messages
    renamed = whole.rename(tmp_path / "a.mcap")
    line = refusal(renamed)
    assert line.startswith(f"{renamed}: is {name}, not an MCAP file; its name must end in {suffix}; if it ")
    assert read(renamed.rename(tmp_path / f"a{suffix}")).messages == sent


@pytest.mark.skipif(shutil.which("sqlite3") is None, reason="needs the program sqlite3")
def test_the_other_way_of_the_docs_saves_what_lies_before_the_damage(tmp_path: Path) -> None:
    page = (Path(__file__).parents[2] / "docs" / "inputs.md").read_text(encoding="utf-8")
    (line,) = re.findall(r"^    (sqlite3 DAMAGED.*)$", page, re.MULTILINE)
    path = sqlite3_bag(tmp_path / "bag")
    path.write_bytes(path.read_bytes()[: path.stat().st_size * 6 // 10])
    subprocess.run(["/bin/sh", "-c", line.replace("DAMAGED.db3", "bag/bag.db3")], cwd=tmp_path, check=True,
                   capture_output=True)
    found = read(tmp_path / "whole.db3").messages
    assert len(found) > len(LONG) // 2 * 5 // 10
    assert found[:-1] == without_publish_time(LONG[::2])[: len(found) - 1]


def test_messages_in_the_journal_of_a_killed_recorder_are_told(tmp_path: Path) -> None:
    with Writer2(tmp_path / "bag", version=9) as writer:
        connection = writer.add_connection("/notes", STRING, typestore=JAZZY)
        for message in FLIGHT[1:5:2]:
            writer.write(connection, message.log_time_ns, message.data)
    with closing(sqlite3.connect(tmp_path / "bag" / "bag.db3")) as database:
        database.execute("pragma journal_mode=wal")
        database.execute("insert into messages select id + 10, topic_id, timestamp, data from messages")
        database.commit()
        shutil.copytree(tmp_path / "bag", tmp_path / "killed")
    found = read(tmp_path / "killed")
    assert len(found.messages) == 2
    assert any("bag.db3-wal beside it holds messages that are not read" in line for line in found.warnings)
    with closing(sqlite3.connect(tmp_path / "killed" / "bag.db3")) as database:  # as the warning says
        database.execute("pragma wal_checkpoint(truncate)")
    assert len(read(tmp_path / "killed").messages) == 4


def bomb(path: Path, chunk: Chunk) -> Path:
    builder = RecordBuilder()
    chunk.write(builder)
    path.write_bytes(MAGIC + builder.end())
    return path


def chunk_of(data: bytes, compression: str, size: int) -> Chunk:
    return Chunk(compression=compression, data=data, message_end_time=0, message_start_time=0, uncompressed_crc=0,
                 uncompressed_size=size)


@pytest.mark.parametrize("chunk", [
    chunk_of(zstandard.compress(bytes(2**26)), "zstd", 1000),
    chunk_of(zstandard.compress(bytes(1000)), "zstd", 2**62),
    chunk_of(b"", "zstd", 2**29),
    chunk_of(b"", "", 2**40),
    chunk_of(b"12345", "", 4),
    chunk_of(b"12345", "rar", 5),
    chunk_of(b"\x05" + b"\xff" * 8, "", 9),
], ids=lambda chunk: f"{chunk.compression}-{chunk.uncompressed_size}")
def test_chunks_that_lie_about_their_size(tmp_path: Path, chunk: Chunk) -> None:
    found = read(bomb(tmp_path / "a.mcap", chunk))
    assert not found.messages
    assert "its messages are lost" in found.warnings[-1]


def test_messages_without_a_channel_are_left_out(tmp_path: Path) -> None:
    builder = RecordBuilder()
    Schema(id=1, data=b"string data", encoding="ros2msg", name=STRING).write(builder)
    Channel(id=1, topic="/notes", message_encoding="cdr", metadata={}, schema_id=1).write(builder)
    for channel_id in (1, 2):
        McapMessage(channel_id=channel_id, log_time=1, data=b"", publish_time=1, sequence=0).write(builder)
    data = builder.end()
    found = read(bomb(tmp_path / "a.mcap", chunk_of(data, "", len(data))))
    assert [message.topic for message in found.messages] == ["/notes"]
    assert f"{tmp_path / 'a.mcap'}: 1 message of unknown topic is left out" in found.warnings


def records_of(texts: list[bytes]) -> bytes:
    """A channel and its messages, at 1 ns and so on."""
    builder = RecordBuilder()
    Schema(id=1, data=b"string data", encoding="ros2msg", name=STRING).write(builder)
    Channel(id=1, topic="/notes", message_encoding="cdr", metadata={}, schema_id=1).write(builder)
    for number, text in enumerate(texts, 1):
        McapMessage(channel_id=1, log_time=number, data=text, publish_time=number, sequence=0).write(builder)
    return bytes(builder.end())


def test_what_lies_before_a_message_without_a_header_in_a_cut_chunk_is_read(tmp_path: Path) -> None:
    short = b"\x05" + (5).to_bytes(8, "little") + bytes(5)
    data = records_of([b"one", b"two"]) + short + records_of([b"three"])
    path = bomb(tmp_path / "a.mcap", chunk_of(data, "", len(data)))
    path.write_bytes(path.read_bytes()[:-3])
    found = read(path)
    assert [message.data for message in found.messages] == [b"one", b"two"]
    assert "is cut off, its first 2 messages are read without the check of a CRC" in found.warnings[-1]


@pytest.mark.parametrize("compression", COMPRESSIONS)
def test_a_chunk_whose_length_alone_is_wrong_is_said_as_it_is(tmp_path: Path, compression: CompressionType) -> None:
    path = by_mcap(tmp_path / "a.mcap", compression=compression, chunk_size=2**20)
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    (chunk,) = summary.chunk_indexes
    content = bytearray(path.read_bytes()[: chunk.chunk_start_offset + chunk.chunk_length])
    content[chunk.chunk_start_offset + 5] ^= 1  # 4 GB more
    path.write_bytes(content)
    found = read(path)
    assert found.messages == FLIGHT
    assert found.warnings[-1] == (f"{path}: the part at byte {chunk.chunk_start_offset} has a wrong length, "
                                  f"its {len(FLIGHT)} messages are read, what follows is lost")
    content[chunk.chunk_start_offset + 200] ^= 1
    path.write_bytes(content)
    assert "its messages are lost" in read(path).warnings[-1]


def test_zeros_that_a_crashed_file_system_leaves(tmp_path: Path) -> None:
    path = by_mcap(tmp_path / "a.mcap")
    with path.open("r+b") as file:
        file.truncate(30_000)
        file.truncate(2**33)  # a hole
    found = read(path)
    assert 0 < len(found.messages) < len(FLIGHT)
    assert found.messages == FLIGHT[: len(found.messages)]
