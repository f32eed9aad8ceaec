"""Recordings with seeded damage and files that explode: what is readable is read, the rest is told, in bounds."""

from __future__ import annotations

import json
import re
import struct
import subprocess
import sys
import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import lz4.frame
import numpy as np
import pytest
import zstandard
from bag_makers import FLIGHT, JAZZY, by_mcap, read
from corruption import KINDS, ReadOutcome
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import Chunk
from mcap.writer import CompressionType

from stab_ros.core.errors import InputError, MessageError
from stab_ros.io.cdr import CAMERA_INFO
from stab_ros.io.homographies import read_homographies
from stab_ros.io.homography_message import read_homography
from stab_ros.io.mcap_records import MAGIC, RECORD_HEAD, RECORD_LIMIT, split
from stab_ros.io.points import read_points
from stab_ros.io.regions import read_area
from stab_ros.io.static_maps import read_static_map
from stab_ros.parameters.file import read_config

CASES = 500
MEMORY_MB = 300
CASE_S = 10.0
GIGABYTE = 2**30
CHILD = Path(__file__).with_name("corruption.py")


def outcomes(folder: Path, tasks: Sequence[dict[str, Any]]) -> list[ReadOutcome]:
    """Of all tasks, read by one child, which stays within bounds."""
    (folder / "tasks.json").write_text(json.dumps(tasks), encoding="utf-8")
    done = subprocess.run([sys.executable, str(CHILD), str(folder / "tasks.json")], capture_output=True, text=True,
                          timeout=600, check=False)
    found = [ReadOutcome(**json.loads(line)) for line in done.stdout.splitlines()]
    assert done.returncode == 0, (done.stderr, found[-1:])
    assert len(found) == len(tasks)
    for one in found:
        assert one.seconds < CASE_S, one
        assert one.peak_mb < MEMORY_MB, one
        assert all(len(line.splitlines()) == 1 for line in (one.error or "-", *one.warnings)), one
    return found


# damage ---------------------------------------------------------------------------------------------------------------
def test_five_hundred_corruptions_are_told_honestly(tmp_path: Path) -> None:
    tasks = []
    for number in range(CASES):
        compression = list(CompressionType)[number % len(CompressionType)]
        sound = tmp_path / f"{compression.name}.mcap"
        if not sound.exists():
            by_mcap(sound, compression=compression)
        kind = list(KINDS)[number // len(CompressionType) % len(KINDS)]
        tasks.append({"path": str(tmp_path / "damaged.mcap"), "sound": str(sound), "kind": kind, "seed": number})
    found = outcomes(tmp_path, tasks)
    for one in found:
        assert one.honest, one
        assert one.warnings or one.error or one.lost == 0, one
        assert all(line.startswith(one.task["path"]) for line in (*one.warnings, one.error or one.task["path"])), one
        assert all(re.search(r"at byte \d+|unknown topic", line) for line in one.warnings), one
        assert not one.error or re.search("is empty|is cut short|must begin with", one.error), one
        if one.task["kind"] in ("flipped", "huge") and not one.error:
            assert one.lost <= 10, one  # a chunk
    assert sum(one.messages > 0 for one in found) > 0.8 * CASES


# bombs ----------------------------------------------------------------------------------------------------------------
def chunk(folder: Path, name: str, packed: bytes, compression: str, size: int) -> Path:
    """A bag of one chunk that claims `size`."""
    builder = RecordBuilder()
    Chunk(compression=compression, data=packed, message_start_time=0, message_end_time=0, uncompressed_crc=0,
          uncompressed_size=size).write(builder)
    path = folder / f"{name}.mcap"
    path.write_bytes(MAGIC + builder.end())
    return path


def zstd_bomb(told: bool) -> bytes:
    """A gigabyte of zeros; `told`: its size stands in its header."""
    packer = zstandard.ZstdCompressor().compressobj(GIGABYTE if told else -1)
    return b"".join(packer.compress(bytes(2**24)) for _ in range(GIGABYTE // 2**24)) + packer.flush()


def lz4_bomb() -> bytes:
    packer = lz4.frame.LZ4FrameCompressor()
    pieces = (packer.compress(bytes(2**24)) for _ in range(GIGABYTE // 2**24))
    return b"".join((packer.begin(), *pieces, packer.flush()))


def png_chunk(kind: bytes, body: bytes) -> bytes:
    return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))


def png(width: int, height: int, *more: bytes, bits: int = 8) -> bytes:
    """A black picture in colour."""
    packer = zlib.compressobj(1)
    row = bytes(1 + width * 3 * bits // 8)
    packed = b"".join(packer.compress(row) for _ in range(height)) + packer.flush()
    head = struct.pack(">IIBBBBB", width, height, bits, 2, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + png_chunk(b"IHDR", head) + b"".join(more) + png_chunk(b"IDAT", packed) + png_chunk(
        b"IEND", b"")


def text_bomb() -> bytes:
    packer = zlib.compressobj(1)
    return b"".join(packer.compress(bytes(2**24)) for _ in range(GIGABYTE // 2**24)) + packer.flush()


def jpeg(width: int, height: int, *options: int) -> bytes:
    """As large by its header, and as long as that needs."""
    data = bytes(cv2.imencode(".jpg", np.zeros((16, 16, 3), np.uint8), options)[1])
    at = next(at for marker in (b"\xff\xc0", b"\xff\xc2") for at in [data.find(marker)] if at > 0)
    body = data[: at + 5] + struct.pack(">HH", height, width) + data[at + 9 : -2]
    return body + bytes(width * height // 500) + b"\xff\xd9"


def test_chunks_that_explode(tmp_path: Path) -> None:
    tasks: list[dict[str, str]] = []
    for name, packed in (("zstd", zstd_bomb(told=False)), ("zstd", zstd_bomb(told=True)), ("lz4", lz4_bomb())):
        for size in (1000, RECORD_LIMIT, GIGABYTE, 2**62):
            tasks.append({"path": str(chunk(tmp_path, f"{name}{len(tasks)}", packed, name, size))})
    for one in outcomes(tmp_path, tasks):
        assert one.messages == 0
        assert any("at byte 8 " in line and "are lost" in line for line in one.warnings), one


def packed_records(compression: str, body: bytes) -> bytes:
    return lz4.frame.compress(body) if compression == "lz4" else zstandard.compress(body) if compression else body


@pytest.mark.parametrize("compression", ["", "lz4", "zstd"])
def test_chunks_of_the_largest_size_stay_within_bounds(tmp_path: Path, compression: str) -> None:
    zeros = bytes(RECORD_LIMIT - 100)  # less the head of the chunk
    many = (RECORD_HEAD.pack(Opcode.MESSAGE, 22) + bytes(22)) * (len(zeros) // 31)  # empty messages
    tasks = [{"path": str(chunk(tmp_path, name, packed_records(compression, body), compression, len(body)))}
             for name, body in (("zeros", zeros), ("many", many))]
    zeros_read, many_read = outcomes(tmp_path, tasks)
    assert any("holds zeros" in line for line in zeros_read.warnings)
    assert any("messages, its messages are lost" in line for line in many_read.warnings)


@pytest.mark.parametrize("chunked", [True, False])
def test_pictures_in_8k_take_their_size_once(tmp_path: Path, chunked: bool) -> None:
    data = np.random.default_rng(0).bytes(7680 * 4320 * 3)
    message = FLIGHT[0]._replace(data=data)
    path = by_mcap(tmp_path / "8k.mcap", [message, FLIGHT[1]], compression=CompressionType.NONE, use_chunking=chunked,
                   chunk_size=1)
    one, = outcomes(tmp_path, [{"path": str(path)}])
    assert (one.messages, one.warnings) == (2, [])
    assert read(path).messages == [message, FLIGHT[1]]


def test_holes_as_long_as_they_claim(tmp_path: Path) -> None:
    tasks = []
    for opcode in (Opcode.CHUNK, Opcode.MESSAGE, Opcode.SCHEMA, Opcode.HEADER, 0x90):
        path = tmp_path / f"{int(opcode)}.mcap"
        path.write_bytes(MAGIC + RECORD_HEAD.pack(opcode, GIGABYTE))
        with path.open("r+b") as file:
            file.truncate(len(MAGIC) + RECORD_HEAD.size + GIGABYTE)
        tasks.append({"path": str(path)})
    found = outcomes(tmp_path, tasks)
    assert all(one.messages == 0 and one.warnings for one in found)
    for one in found[:3]:
        assert any(f"at byte 8 claims {GIGABYTE + RECORD_HEAD.size} bytes" in line for line in one.warnings), one


def test_pictures_that_explode(tmp_path: Path) -> None:
    side = 18_919  # a gigabyte in 8 bit
    zipped = text_bomb()
    files = {
        "large.png": png(side, side), "deep.png": png(side // 2, side, bits=16), "long.png": png(3, 2**20),
        "text.png": png(6, 4, png_chunk(b"zTXt", b"a\0\0" + zipped)),
        "profile.png": png(6, 4, png_chunk(b"iCCP", b"a\0\0" + zipped)),
        "animated.png": png(6, 4, png_chunk(b"acTL", struct.pack(">II", 2**31 - 1, 0))),
        "claim.png": png(6, 4)[:16] + struct.pack(">II", 6000, 6000) + png(6, 4)[24:],
        "large.jpg": jpeg(side, side), "progressive.jpg": jpeg(side, side // 3, cv2.IMWRITE_JPEG_PROGRESSIVE, 1),
    }
    for name, data in files.items():
        (tmp_path / name).write_bytes(data)
    found = {Path(one.task["path"]).name: one for one in outcomes(
        tmp_path, [{"path": str(tmp_path / name)} for name in files])}
    for name in ("large.png", "deep.png", "large.jpg", "progressive.jpg"):
        assert "image width x height" in found[name].error, found[name]
    assert "cut short" in found["claim.png"].error
    assert "animated" in found["animated.png"].error


# text -----------------------------------------------------------------------------------------------------------------
LAUGHS = "a0: &a0 [x]\n" + "".join(f"a{n + 1}: &a{n + 1} {{x: *a{n}, y: *a{n}, z: *a{n}}}\n" for n in range(40))
PARAMETERS = "/**: {{ros__parameters: {{{}}}}}"


@pytest.mark.parametrize("text", [
    LAUGHS, LAUGHS + "/**: {ros__parameters: *a40}\n", "&a a: *a", "[" * 50_000, "{a: " * 50_000, "- " * 50_000,
    PARAMETERS.format("min_inliers: 0x" + "f" * 9000), PARAMETERS.format("0x" + "f" * 9000 + ": 1"),
    PARAMETERS.format("min_inliers: 1" + ":59" * 30_000), PARAMETERS.format("min_inliers: !!bool x"),
    PARAMETERS.format("min_inliers: !!timestamp x"), PARAMETERS.format("min_inliers: 2001-99-99"),
    "x: 1\n" * 300_000, '"a\\nb": {ros__parameters: {}}',
], ids=lambda text: f"{text[:12]}-{len(text)}")
def test_hostile_parameter_files_are_one_line(tmp_path: Path, text: str) -> None:
    path = tmp_path / "p.yaml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError) as refused:
        read_config(path)
    assert str(refused.value).startswith((f"{path}: ", "min_inliers", "parameter"))
    assert len(str(refused.value).splitlines()) == 1
    assert len(str(refused.value)) < 2000


def test_large_tables_are_read_in_their_length(tmp_path: Path) -> None:
    """Nothing here is quadratic: it would take hours."""
    points, table = tmp_path / "points.csv", tmp_path / "H.csv"
    points.write_text("name,x,y\n" + "".join(f"P{n},1,2\n" for n in range(90_000)), encoding="utf-8")
    assert len(read_points(points)) == 90_000
    points.write_text("name,x,y\n" + "".join(f"P{n},1,2\n" for n in range(300_000)), encoding="utf-8")
    with pytest.raises(InputError, match="more than 100000 points"):
        read_points(points)
    columns = ",".join(f"c{n}" for n in range(200_000))
    points.write_text(f"name,x,y,{columns}\n" + "".join(f"P{n},1,2\n" for n in range(50_000)), encoding="utf-8")
    assert len(read_points(points)) == 50_000
    header = "frame,stamp_ns,status,h00,h01,h02,h10,h11,h12,h20,h21,h22"
    table.write_text(f"{header},{columns}\n" + "0,0,LOST\n" * 100_000, encoding="utf-8")
    assert len(read_homographies(table)) == 100_000


def test_polygons_beyond_counting_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "roi.json"
    for text in (json.dumps([[[n, n * n] for n in range(50_000)]]), "[" + " " * 2**21 + "]"):
        path.write_text(text, encoding="utf-8")
        with pytest.raises(InputError, match="use a PNG mask"):
            read_area({"roi": str(path)})


@pytest.mark.parametrize("name", ["a\0b", "x" * 5000])
def test_no_possible_names_of_files(name: str) -> None:
    for reader in (lambda: read_points(Path(name)), lambda: read_homographies(Path(name)),
                   lambda: read_config(Path(name)), lambda: read_static_map({"static_map": name})):
        with pytest.raises(InputError) as refused:
            reader()
        assert len(str(refused.value).splitlines()) == 1


def chunk_indexes(data: bytearray) -> list[int]:
    """Where the bodies of these records begin, in a bag without CRCs."""
    (start,) = struct.unpack_from("<Q", data, len(data) - len(MAGIC) - 20)
    summary = memoryview(data)[start : -len(MAGIC)]
    return [start + at for opcode, at, _ in split(summary) if opcode == Opcode.CHUNK_INDEX]


def test_one_chunk_listed_again_and_again_is_read_once(tmp_path: Path) -> None:
    path = by_mcap(tmp_path / "a.mcap", enable_crcs=False)
    data = bytearray(path.read_bytes())
    first, *others = chunk_indexes(data)
    for other in others:
        data[other + 16 : other + 32] = data[first + 16 : first + 32]  # its offset and length
    path.write_bytes(data)
    found = read(path)
    assert found.messages == FLIGHT
    assert re.search(r"the index at byte \d+ lists parts that overlap at byte \d+", found.warnings[0])


def test_messages_before_the_time_their_index_gives_do_not_break_the_order(tmp_path: Path) -> None:
    path = by_mcap(tmp_path / "a.mcap", enable_crcs=False)
    data = bytearray(path.read_bytes())
    first = chunk_indexes(data)[0]
    data[first : first + 8] = struct.pack("<Q", FLIGHT[2].log_time_ns)
    path.write_bytes(data)
    found = read(path)
    assert found.messages == FLIGHT[2:]
    assert "holds 2 messages from before the time that the index gives" in found.warnings[0]


def test_a_homography_too_close_to_zero_is_refused() -> None:
    """Its K is of full rank by numpy, which cannot invert it all the same."""
    K = np.array([2.06e-317, 2.09e-317, 0, 2.09e-317, 0, 2.09e-317, 2.08e-317, 0, 0])
    roi = JAZZY.types["sensor_msgs/msg/RegionOfInterest"](0, 0, 0, 0, False)
    header = JAZZY.types["std_msgs/msg/Header"](JAZZY.types["builtin_interfaces/msg/Time"](0, 0), "")
    message = JAZZY.types[CAMERA_INFO](header, 3, 4, "", np.zeros(0), K, np.eye(3).ravel(), np.ones(12), 0, 0, roi)
    with pytest.raises(MessageError, match="K invertible"):
        read_homography(bytes(JAZZY.serialize_cdr(message, CAMERA_INFO)))
