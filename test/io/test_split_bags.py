"""Recordings of several files in every storage and compression: whole, in disorder, with parts missing or damaged."""

from __future__ import annotations

import subprocess
import tracemalloc
from pathlib import Path

import pytest
import yaml
import zstandard
from bag_makers import FLIGHT, JAZZY, STRING, TOPICS, by_mcap, read, without_publish_time
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Writer2

from stab_ros.core.errors import InputError
from stab_ros.io.bag import Message, open_bag

PARTS = 3
WANTED = without_publish_time(FLIGHT)
EACH = len(WANTED) // PARTS
KINDS = [(StoragePlugin.SQLITE3, None), (StoragePlugin.SQLITE3, CompressionMode.MESSAGE),
         (StoragePlugin.SQLITE3, CompressionMode.FILE), (StoragePlugin.MCAP, CompressionMode.MESSAGE),
         (StoragePlugin.MCAP, CompressionMode.FILE), (StoragePlugin.MCAP, None)]
every_kind = pytest.mark.parametrize(("storage", "mode"), KINDS, ids=lambda value: value.name if value else "plain")


def split(folder: Path, storage: StoragePlugin, mode: CompressionMode | None,
          order: tuple[int, ...] = (0, 1, 2)) -> list[Path]:
    """The files, as `ros2 bag record --max-bag-size` leaves them; metadata.yaml lists them in this order."""
    folder.mkdir()
    files, metadata = [], dict[str, dict[str, object]]()
    for number in range(PARTS):
        writer = Writer2(folder.with_name(f"{folder.name}_{number}"), version=9, storage_plugin=storage)
        if mode:
            writer.set_compression(mode, CompressionFormat.ZSTD)
        with writer:
            ids = {t.name: writer.add_connection(t.name, t.msgtype, typestore=JAZZY) for t in TOPICS}
            for message in WANTED[EACH * number : EACH * (number + 1)]:
                writer.write(ids[message.topic], message.log_time_ns, message.data)
        made, = writer.path.glob(f"{folder.name}_*")
        files.append(made.rename(folder / made.name))
        metadata = yaml.safe_load((writer.path / "metadata.yaml").read_text())
    metadata["rosbag2_bagfile_information"]["relative_file_paths"] = [files[number].name for number in order]
    (folder / "metadata.yaml").write_text(yaml.safe_dump(metadata))
    return files


@every_kind
def test_parts_are_one_recording_in_whatever_order(
        tmp_path: Path, storage: StoragePlugin, mode: CompressionMode | None) -> None:
    split(tmp_path / "bag", storage, mode, (2, 0, 1))
    found = read(tmp_path / "bag")
    assert found[:2] == (WANTED, [])
    assert {topic.name: topic.count for topic in found.topics.values()} == {
        "/cam/image_raw": 12, "/notes": 12, "/silent": 0}
    assert read(tmp_path / "bag", "/notes").messages == WANTED[1::2]


@every_kind
@pytest.mark.parametrize("damage", ["missing", "empty", "cut"])
def test_the_other_parts_are_read(
        tmp_path: Path, storage: StoragePlugin, mode: CompressionMode | None, damage: str) -> None:
    part = split(tmp_path / "bag", storage, mode)[1]
    content = part.read_bytes()
    part.unlink()
    if damage != "missing":
        part.write_bytes(content[: len(content) // 2 if damage == "cut" else 0])
    found = read(tmp_path / "bag")
    kept = len(found.messages) - 2 * EACH  # of an MCAP that is cut off, what lies before the cut
    assert found.messages == WANTED[: EACH + kept] + WANTED[2 * EACH :]
    assert kept == 0 or (0 < kept < EACH and damage == "cut" and part.suffix == ".mcap")
    assert all(str(part).removesuffix(".zstd") in line for line in found.warnings)
    assert damage != "missing" or found.warnings == [f"{part}: is missing, its messages are lost"]
    assert 1 <= len(found.warnings) <= 2
    assert "/tmp/tmp" not in "".join(found.warnings)  # the place of unpacked files


@every_kind
def test_a_killed_recorder_leaves_no_metadata(
        tmp_path: Path, storage: StoragePlugin, mode: CompressionMode | None) -> None:
    files = split(tmp_path / "bag", storage, mode)
    (tmp_path / "bag" / "metadata.yaml").unlink()
    found = read(tmp_path / "bag")
    assert found.messages == WANTED
    assert found.warnings == [f"{tmp_path / 'bag'}: has no readable metadata.yaml, all its "
                              f"{''.join(files[0].suffixes)} files were taken"]


@every_kind
def test_one_file_of_a_recording(tmp_path: Path, storage: StoragePlugin, mode: CompressionMode | None) -> None:
    """That its messages are compressed stands in metadata.yaml alone."""
    for number, path in enumerate(split(tmp_path / "bag", storage, mode)):
        assert read(path)[:2] == (WANTED[EACH * number : EACH * (number + 1)], [])


def test_files_that_the_metadata_does_not_list_are_named(tmp_path: Path) -> None:
    files = split(tmp_path / "bag", StoragePlugin.SQLITE3, None, (0, 2, 0))  # and one twice
    found = read(tmp_path / "bag")
    assert found.messages == WANTED[:EACH] + WANTED[2 * EACH :]
    assert found.warnings == [f"{files[1]}: is not listed in metadata.yaml, it was left out"]


def test_files_that_were_unpacked_or_packed_by_hand(tmp_path: Path) -> None:
    unpacked, *_ = split(tmp_path / "bag", StoragePlugin.MCAP, CompressionMode.FILE)
    with unpacked.open("rb") as packed:
        unpacked.with_suffix("").write_bytes(zstandard.ZstdDecompressor().stream_reader(packed).read())
    unpacked.unlink()
    assert read(tmp_path / "bag")[:2] == (WANTED, [])
    files = split(tmp_path / "other", StoragePlugin.SQLITE3, None)
    files[2].with_name(f"{files[2].name}.zstd").write_bytes(zstandard.compress(files[2].read_bytes()))
    files[2].unlink()
    assert read(tmp_path / "other")[:2] == (WANTED, [])


@pytest.mark.parametrize("name", ["pipe", ".", "..", "folder"])
def test_what_is_no_file_is_not_opened(tmp_path: Path, name: str) -> None:
    folder = tmp_path / "bag"
    first, *others = split(folder, StoragePlugin.SQLITE3, CompressionMode.MESSAGE)
    (folder / "folder").mkdir()
    subprocess.run(["mkfifo", folder / "pipe"], check=True)
    metadata = folder / "metadata.yaml"
    metadata.write_text(metadata.read_text().replace(first.name, name))
    (tmp_path / "bag.zstd").write_bytes(others[0].read_bytes())  # next to the folder
    assert "is no file, its messages are lost" in read(folder).warnings[0]
    for other in (first, *others):
        other.unlink()
    with pytest.raises(InputError, match="is no file"):
        read(folder)


# memory ---------------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("storage", StoragePlugin)
def test_only_the_part_whose_time_has_come_is_in_memory(tmp_path: Path, storage: StoragePlugin) -> None:
    size, count = 2**23, 6
    (tmp_path / "bag").mkdir()
    for number in range(count):
        with Writer2(tmp_path / f"part_{number}", version=9, storage_plugin=storage) as writer:
            connection = writer.add_connection("/notes", STRING, typestore=JAZZY)
            writer.write(connection, number + 1, bytes(size))
        made, = writer.path.glob("part_*")
        made.rename(tmp_path / "bag" / made.name)
    with open_bag(tmp_path / "bag") as reader:
        tracemalloc.start()
        assert sum(len(message.data) for message in reader.messages()) == count * size
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
    assert peak < 4 * size


def test_memory_does_not_grow_with_the_number_of_messages(tmp_path: Path) -> None:
    peaks = []
    for count in (4_000, 16_000):
        messages = [Message("/notes", number, number, bytes(100)) for number in range(count)]
        path = by_mcap(tmp_path / f"{count}.mcap", messages, chunk_size=2**17)
        tracemalloc.start()
        with open_bag(path) as reader:
            assert sum(1 for _ in reader.messages()) == count
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < 1.2 * peaks[0]
