"""Small recordings that would unpack to a gigabyte: one line or warnings, little memory, nothing left on the disk."""

from __future__ import annotations

import bz2
import json
import sqlite3
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import lz4.frame
import pytest
from ailing import needs_root, small_disk
from bag_makers import JAZZY, START_NS, STRING, read, text_cdr
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore

from stab_ros.core.errors import InputError
from stab_ros.io.compression import UNPACKED_LIMIT, unpacked, unpacked_message

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

GIB = 2**30
PEAK_LIMIT = 300 * 10**6  # bytes
BIGGEST_FILE = 6 * 10**6  # bytes
ZEROS = bytes(2**24)
NOETIC: Any = get_typestore(Stores.ROS1_NOETIC)

# in a process of its own: what is read, and the most memory that took
CHILD = """
import json, re, sys
from pathlib import Path
from stab_ros.core.errors import InputError
from stab_ros.io.bag import open_bag
said, texts = [], []
try:
    with open_bag(Path(sys.argv[1])) as bag:
        texts = [message.data[8:-1].decode() for message in bag.messages() if len(message.data) < 100]
        said = list(bag.warnings)
except InputError as error:
    said = [f"refused {error}"]
peak = 1024 * int(re.search(r"VmHWM:\\s+(\\d+) kB", Path("/proc/self/status").read_text())[1])
print(json.dumps([texts, said, peak]))
"""


class Outcome(NamedTuple):
    """What a child read: texts, warnings or the refusal, and its peak memory in bytes."""

    texts: list[str]
    said: list[str]
    peak: int


def outcome(path: Path, folder: Path) -> Outcome:
    """Temporary files go to `folder`, where none may be left."""
    before = sorted(folder.rglob("*"))
    child = subprocess.run([sys.executable, "-c", CHILD, str(path)], capture_output=True, text=True, timeout=120,
                           check=True, env={"TMPDIR": str(folder), "PATH": "/usr/bin:/bin"})
    assert sorted(folder.rglob("*")) == before
    found = Outcome(*json.loads(child.stdout))
    assert found.peak < PEAK_LIMIT
    assert len(found.said) == 1
    assert len(found.said[0].splitlines()) == 1
    return found


def zstd_bomb() -> bytes:
    press = zstd.ZstdCompressor()
    return b"".join(press.compress(ZEROS) for _ in range(GIB // len(ZEROS))) + press.flush()


def lz4_bomb() -> bytes:
    press = lz4.frame.LZ4FrameCompressor()
    pieces = [press.begin(), *(press.compress(ZEROS) for _ in range(GIB // len(ZEROS))), press.flush()]
    return b"".join(map(bytes, pieces))


def bz2_bomb() -> bytes:
    """Only 0.3 GiB: it takes so long to make."""
    press = bz2.BZ2Compressor()
    return b"".join(press.compress(ZEROS) for _ in range(20)) + press.flush()


# the recordings -------------------------------------------------------------------------------------------------------
def ros1(path: Path, compression: Writer1.CompressionFormat, bomb: Callable[[], bytes]) -> Path:
    """A sound chunk with three texts, and one that is a bomb and says in its header that it is small."""
    writer = Writer1(path)
    writer.set_compression(compression)
    with writer:
        connection = writer.add_connection("/notes", STRING, typestore=NOETIC)
        for number in range(4):
            if number == 3:
                writer.write_chunk(writer.chunks[-1])
                writer.compressor = lambda _: bomb()
            text = NOETIC.serialize_ros1(NOETIC.types[STRING](f"note {number}"), STRING)
            writer.write(connection, START_NS + number, text)
    return path


def folder_of(path: Path, storage: StoragePlugin, mode: CompressionMode) -> Path:
    """Four texts."""
    writer = Writer2(path, version=9, storage_plugin=storage)
    writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        connection = writer.add_connection("/notes", STRING, typestore=JAZZY)
        for number in range(4):
            writer.write(connection, START_NS + number, text_cdr(f"note {number}"))
    return path


def messages_folder(path: Path) -> Path:
    """Its third message is a bomb."""
    folder_of(path, StoragePlugin.SQLITE3, CompressionMode.MESSAGE)
    database = sqlite3.connect(path / f"{path.name}.db3")
    database.execute("UPDATE messages SET data = ? WHERE timestamp = ?", (zstd_bomb(), START_NS + 2))
    database.commit()
    database.close()
    return path


def file_folder(path: Path) -> Path:
    """A sound database, followed by a gigabyte of zeros."""
    folder_of(path, StoragePlugin.SQLITE3, CompressionMode.FILE)
    with (path / f"{path.name}.db3.zstd").open("ab") as file:
        file.write(zstd_bomb())
    return path


def chunk_folder(path: Path, compression: str, bomb: bytes, claimed: int) -> Path:
    """An MCAP file in a folder of compressed messages; `claimed`: the unpacked size that its only chunk tells."""
    folder_of(path, StoragePlugin.MCAP, CompressionMode.MESSAGE)
    (file,) = path.glob("*.mcap")
    content = file.read_bytes()
    head = 8 + 9 + int.from_bytes(content[9:17], "little")  # magic and header record
    file.write_bytes(content[:head] + chunk_record(compression, bomb, claimed) + WITHOUT_INDEX)
    return path


def chunk_record(compression: str, packed: bytes, claimed: int) -> bytes:
    name = compression.encode()
    body = (bytes(16) + claimed.to_bytes(8, "little") + bytes(4) + len(name).to_bytes(4, "little") + name
            + len(packed).to_bytes(8, "little") + packed)
    return b"\x06" + len(body).to_bytes(8, "little") + body


WITHOUT_INDEX = b"\x02" + (20).to_bytes(8, "little") + bytes(20) + b"\x89MCAP0\r\n"


def computing_database(path: Path) -> Path:
    """A few kilobytes whose table computes a gigabyte."""
    database = sqlite3.connect(path)
    database.executescript(f"""
        CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT,
                            offered_qos_profiles TEXT);
        CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER,
                              data BLOB GENERATED ALWAYS AS (zeroblob(999000000)) VIRTUAL);
        INSERT INTO topics VALUES (1, '/notes', '{STRING}', 'cdr', '');
        INSERT INTO messages(id, topic_id, timestamp) VALUES (1, 1, {START_NS});""")
    database.close()
    return path


# what comes of them ---------------------------------------------------------------------------------------------------
@pytest.mark.parametrize(("compression", "bomb"), [
    (Writer1.CompressionFormat.BZ2, bz2_bomb), (Writer1.CompressionFormat.LZ4, lz4_bomb)])
def test_ros1_chunk(tmp_path: Path, compression: Writer1.CompressionFormat, bomb: Callable[[], bytes]) -> None:
    path = ros1(tmp_path / "a.bag", compression, bomb)
    assert path.stat().st_size < BIGGEST_FILE
    found = outcome(path, tmp_path)
    assert found.texts == ["note 0", "note 1", "note 2"]
    assert f"it unpacks to more than {UNPACKED_LIMIT} bytes), what follows is lost" in found.said[0]


def test_message_of_a_folder_is_left_out_alone(tmp_path: Path) -> None:
    found = outcome(messages_folder(tmp_path / "bag"), tmp_path)
    assert found.texts == ["note 0", "note 1", "note 3"]
    assert f"a message of /notes at {START_NS + 2} ns is damaged (it unpacks to more than" in found.said[0]


def test_whole_file_is_not_unpacked_to_the_disk(tmp_path: Path) -> None:
    found = outcome(file_folder(tmp_path / "bag"), tmp_path)
    assert not found.texts
    assert found.said[0].startswith("refused")
    assert f"bag.db3.zstd: unpacks to more than {UNPACKED_LIMIT} bytes" in found.said[0]


@pytest.mark.parametrize("claimed", [1000, GIB])
@pytest.mark.parametrize(("compression", "bomb"), [("zstd", zstd_bomb), ("lz4", lz4_bomb)])
def test_mcap_chunk_within_a_compressed_folder(
        tmp_path: Path, compression: str, bomb: Callable[[], bytes], claimed: int) -> None:
    found = outcome(chunk_folder(tmp_path / "bag", compression, bomb(), claimed), tmp_path)
    assert not found.texts
    assert "its messages are lost" in found.said[0]


def test_database_that_computes_its_messages(tmp_path: Path) -> None:
    found = outcome(computing_database(tmp_path / "a.db3"), tmp_path)
    assert not found.texts
    assert "too big" in found.said[0]


@needs_root
def test_full_disk_leaves_room(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Unpacked files may take half of what is free, in sum."""
    path = folder_of(tmp_path / "bag", StoragePlugin.SQLITE3, CompressionMode.FILE)
    assert len(read(path).messages) == 4
    with small_disk(tmp_path / "temporary", 20) as temporary:
        monkeypatch.setattr(tempfile, "tempdir", str(temporary))
        with pytest.raises(InputError, match=r"unpacks to more than \d+ bytes"):
            read(path)
        assert not list(temporary.iterdir())


def test_index_that_is_told_over_and_over(tmp_path: Path) -> None:
    """Every chunk entry of a ROS 1 index names the same chunk."""
    writer = Writer1(tmp_path / "a.bag")
    with writer:
        connection = writer.add_connection("/notes", STRING, typestore=NOETIC)
        for number in range(1000):
            writer.write(connection, START_NS + number, NOETIC.serialize_ros1(NOETIC.types[STRING]("a"), STRING))
        writer.write_chunk(writer.chunks[-1])
        writer.chunks[:] = [writer.chunks[0]] * 1000 + writer.chunks[1:]
    with pytest.raises(InputError, match="index is longer than the file"):
        read(tmp_path / "a.bag")


# what is honest -------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("size", [0, 1, 2**20, 2**20 + 1, 30_000_000])
def test_what_fits_is_unpacked(size: int) -> None:
    data = bytes(size)
    assert unpacked(zstd.ZstdDecompressor(), zstd.compress(data)) == data
    assert unpacked(bz2.BZ2Decompressor(), bz2.compress(data)) == data
    assert unpacked(lz4.frame.LZ4FrameDecompressor(), lz4.frame.compress(data)) == data
    assert unpacked(zstd.ZstdDecompressor(), zstd.compress(data), limit=size) == data


@pytest.mark.parametrize("packed", [b"", zstd.compress(b"text")[:-1], zstd.compress(b"text") + b"x", b"text"])
def test_damaged_messages_are_damage(packed: bytes) -> None:
    with pytest.raises((EOFError, ValueError, zstd.ZstdError)):
        unpacked_message(packed)


@pytest.mark.parametrize("mode", [CompressionMode.MESSAGE, CompressionMode.FILE])
@pytest.mark.parametrize("storage", StoragePlugin)
def test_folders_with_odd_names_are_read(tmp_path: Path, storage: StoragePlugin, mode: CompressionMode) -> None:
    folder_of(tmp_path / "bag", storage, mode)
    path = (tmp_path / "bag").rename(tmp_path / "flight #3, 50%25 ?")
    assert [message.data for message in read(path).messages] == [text_cdr(f"note {number}") for number in range(4)]
