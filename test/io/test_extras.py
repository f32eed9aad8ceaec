"""Attachments and metadata of MCAP files: byte for byte in every output, from intact and damaged files."""

from __future__ import annotations

import subprocess
import sys
import tracemalloc
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from bag_makers import EXTRAS, FLIGHT, METADATA, by_mcap, read, with_extras
from conftest import Command
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.records import Attachment, Metadata
from mcap.writer import CompressionType, IndexType
from rosbags.rosbag2 import Reader as Reader2

from stab_ros.io.bag import BagWriter, open_bag
from stab_ros.io.mcap_records import MAGIC, RECORD_HEAD, split


def records(path: Path) -> list[bytes]:
    """The bytes of all attachments and metadata, in the order of the file."""
    data = path.read_bytes()
    whole = memoryview(data)[len(MAGIC) : -len(MAGIC)]
    return [bytes(whole[start - RECORD_HEAD.size : end]) for opcode, start, end in split(whole)
            if opcode in (Opcode.ATTACHMENT, Opcode.METADATA)]


def held(path: Path) -> list[Attachment | Metadata]:
    """Attachments and metadata as mcap's own reader finds them by the index of the file."""
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        summary = reader.get_summary()
        assert summary is not None
        assert summary.statistics is not None
        found: list[object] = [*reader.iter_attachments(), *reader.iter_metadata()]
        assert [len(summary.attachment_indexes), len(summary.metadata_indexes)] == [
            summary.statistics.attachment_count, summary.statistics.metadata_count]
    assert all(extra in EXTRAS for extra in found)
    return [extra for extra in EXTRAS for other in found if extra == other]


# carried over ---------------------------------------------------------------------------------------------------------
WAYS = [{}, {"compression": CompressionType.NONE}, {"use_chunking": False}, {"index_types": IndexType.NONE},
        {"index_types": IndexType.ALL ^ IndexType.ATTACHMENT}, {"use_statistics": False},
        {"use_summary_offsets": False}, {"enable_crcs": False, "enable_data_crcs": True}]


@pytest.mark.parametrize("options", WAYS, ids=str)
@pytest.mark.parametrize("job", ["convert", "recover"])
def test_extras_are_carried_over_byte_for_byte(
        tmp_path: Path, command: Command, job: str, options: dict[str, Any]) -> None:
    source = with_extras(by_mcap(tmp_path / "plain.mcap"), tmp_path / "a.mcap", **options)
    done = command(job, source, tmp_path / "b.mcap")
    assert (done.returncode, done.stderr) == (0, "")
    assert records(tmp_path / "b.mcap") == records(source)
    assert held(tmp_path / "b.mcap") == list(EXTRAS)
    assert read(tmp_path / "b.mcap")[:2] == (FLIGHT, [])
    with Reader2(tmp_path / "b.mcap") as reader:
        assert reader.message_count == len(FLIGHT)


def test_stabilize_carries_them_over_too(tmp_path: Path, command: Command, recordings: dict[str, Path]) -> None:
    source = with_extras(recordings["mcap"], tmp_path / "a.mcap")
    done = command("stabilize", source, tmp_path / "b.mcap", "--no-image", "--limit", 3)
    assert (done.returncode, done.stderr) == (0, "")
    assert records(tmp_path / "b.mcap") == records(source)
    assert held(tmp_path / "b.mcap") == list(EXTRAS)


def test_extras_without_messages(tmp_path: Path, command: Command) -> None:
    source = with_extras(by_mcap(tmp_path / "plain.mcap", []), tmp_path / "a.mcap")
    for job in ("convert", "recover"):
        done = command(job, source, tmp_path / f"{job}.mcap")
        assert (done.returncode, done.stderr) == (0, "")
        assert held(tmp_path / f"{job}.mcap") == list(EXTRAS)


def test_a_bag_without_extras_has_no_trace_of_them(tmp_path: Path, command: Command) -> None:
    command("convert", by_mcap(tmp_path / "a.mcap"), tmp_path / "b.mcap")
    assert (held(tmp_path / "b.mcap"), records(tmp_path / "b.mcap")) == ([], [])


def test_info_names_them(tmp_path: Path, command: Command) -> None:
    odd = Attachment(name="a\x1b[31m\nb", media_type="", create_time=0, log_time=0, data=b"123")
    source = with_extras(by_mcap(tmp_path / "plain.mcap"), tmp_path / "a.mcap", (*EXTRAS[:2], odd))
    assert command("info", source).stdout.splitlines()[-3:] == [
        "  attachment calibration.yaml: application/yaml, 8 bytes", "  metadata flight",
        "  attachment a\N{REPLACEMENT CHARACTER}[31m b: , 3 bytes"]


def test_extras_of_split_recordings_come_once(tmp_path: Path, command: Command) -> None:
    folder = tmp_path / "bag"
    folder.mkdir()
    own = [Metadata(name="rosbag2", metadata={"serialized_metadata": f"file {number}"}) for number in range(3)]
    for number in range(3):
        plain = by_mcap(tmp_path / "plain.mcap", FLIGHT[8 * number : 8 * number + 8])
        with_extras(plain, folder / f"bag_{number}.mcap", (EXTRAS[0], own[number], EXTRAS[0]))
    (folder / "metadata.yaml").write_text(METADATA)
    done = command("convert", folder, tmp_path / "b.mcap")
    assert (done.returncode, done.stderr) == (0, "")
    of_first, *_ = [records(folder / f"bag_{number}.mcap") for number in range(3)]
    others = [records(folder / f"bag_{number}.mcap")[1] for number in (1, 2)]
    assert records(tmp_path / "b.mcap") == [*of_first, *others]


# damaged --------------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("options", [{}, {"index_types": IndexType.NONE}], ids=str)
def test_damaged_ones_are_left_out_and_said(tmp_path: Path, command: Command, options: dict[str, Any]) -> None:
    source = with_extras(by_mcap(tmp_path / "plain.mcap"), tmp_path / "a.mcap", **options)
    data = bytearray(source.read_bytes())
    changed = data.find(b"fx: 800"), data.find("Ödön".encode())
    for at in changed:
        data[at] ^= 0x84
    source.write_bytes(data)
    for job in ("convert", "recover"):
        done = command(job, source, tmp_path / f"{job}.mcap")
        why, other = done.stderr.splitlines()
        assert done.returncode == 0
        assert "the attachment or metadata at byte" in why
        assert "has a wrong CRC, it is left out" in why
        assert "holds text that is not UTF-8, it is left out" in other
        assert held(tmp_path / f"{job}.mcap") == list(EXTRAS[2:])
        assert read(tmp_path / f"{job}.mcap").messages == FLIGHT


def test_cut_off_recordings_keep_those_before_the_cut(tmp_path: Path, command: Command) -> None:
    source = with_extras(by_mcap(tmp_path / "plain.mcap"), tmp_path / "a.mcap")
    data, whole = source.read_bytes(), records(source)
    starts = [data.find(record) for record in whole]
    assert all(before < after for before, after in pairwise(starts))
    for count in range(1, len(whole)):  # the first one comes before all messages
        source.write_bytes(data[: starts[count] + len(whole[count]) // 2])
        done = command("recover", source, tmp_path / "b.mcap", "--force")
        assert done.returncode == 0, done.stderr
        assert "the whole file was scanned" in done.stderr
        assert records(tmp_path / "b.mcap") == whole[:count]
        assert len(held(tmp_path / "b.mcap")) == count


def test_one_attachment_listed_again_and_again_is_copied_once(tmp_path: Path) -> None:
    twice = (EXTRAS[0], EXTRAS[3])
    source = with_extras(by_mcap(tmp_path / "plain.mcap"), tmp_path / "a.mcap", twice, enable_crcs=False)
    data = bytearray(source.read_bytes())
    first, second = (at for opcode, at, _ in split(memoryview(data)[8:-8]) if opcode == Opcode.ATTACHMENT_INDEX)
    data[second + 8 : second + 24] = data[first + 8 : first + 24]  # offset and length
    source.write_bytes(data)
    with open_bag(source) as reader:
        assert [len(list(extra.pieces())) for extra in reader.extras()] == [1, 1]
        assert "lists parts that overlap" in reader.warnings[0]


# large ----------------------------------------------------------------------------------------------------------------
LARGE = 2**27  # bytes, more than any message may have


def large(path: Path) -> Path:
    """A file with one large attachment, a hole, without a CRC."""
    head = (bytes(16) + b"\x05\0\0\0a.mp4" + b"\x09\0\0\0video/mp4" + LARGE.to_bytes(8, "little"))
    with path.open("wb") as file:
        file.write(MAGIC + RECORD_HEAD.pack(Opcode.ATTACHMENT, len(head) + LARGE + 4) + head)
        file.truncate(file.tell() + LARGE + 4)
    return path


def test_large_attachments_are_streamed(tmp_path: Path) -> None:
    with open_bag(large(tmp_path / "a.mcap")) as reader, BagWriter(tmp_path / "b.mcap") as writer:
        tracemalloc.start()
        writer.add_extras(reader.extras())
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
    assert peak < 2**23
    with open_bag(tmp_path / "b.mcap") as reader:
        assert list(map(str, reader.extras())) == [f"attachment a.mp4: video/mp4, {LARGE} bytes"]
        assert not reader.warnings


FILL_THE_DISK = """
import resource, sys
from stab_ros.cli import main
resource.setrlimit(resource.RLIMIT_FSIZE, (2**22, 2**22))
sys.exit(main(["convert", *sys.argv[1:]]))
"""


def test_full_disk_while_an_attachment_is_copied_leaves_a_readable_part(tmp_path: Path) -> None:
    path = tmp_path / "b.mcap"
    done = subprocess.run([sys.executable, "-c", FILL_THE_DISK, large(tmp_path / "a.mcap"), path],
                          capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert f"{path}: File too large, what was written so far is in {path}.partial" in done.stderr.splitlines()[-1]
    assert read(tmp_path / "b.mcap.partial")[:2] == ([], [])
