"""Records of an MCAP file, read defensively: no size is believed before it is checked (https://mcap.dev/spec)."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from io import BytesIO
from typing import IO, NamedTuple

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, ChunkIndex, Footer, Schema, Statistics

MAGIC = b"\x89MCAP0\r\n"
RECORD_HEAD = struct.Struct("<BQ")  # opcode, length
RECORD_LIMIT = 2**30  # bytes of one record or chunk, unpacked: 100 times a 4K frame
_MESSAGE_HEAD = struct.Struct("<HIQQ")  # channel, sequence, log time, publish time
_CLASSES = {
    Opcode.SCHEMA: Schema,
    Opcode.CHANNEL: Channel,
    Opcode.CHUNK: Chunk,
    Opcode.CHUNK_INDEX: ChunkIndex,
    Opcode.STATISTICS: Statistics,
    Opcode.FOOTER: Footer,
}
# what mcap, lz4 and zstandard raise on damaged bytes
_DAMAGE = (McapError, struct.error, ValueError, RuntimeError, EOFError, MemoryError, zstandard.ZstdError)


class DamagedError(Exception):
    """These bytes are not what they claim to be; says what, for a warning."""


class RecordedMessage(NamedTuple):
    """A message record; compares by log time."""

    log_time_ns: int
    publish_time_ns: int
    channel_id: int
    data: bytes


Record = Schema | Channel | Chunk | ChunkIndex | Statistics | Footer


def read_exactly(file: IO[bytes], offset: int, length: int) -> bytes:
    """`length` bytes at `offset`.

    Raises:
        DamagedError: the file ends before, the length is absurd, or the disk cannot read them.
    """
    if length > RECORD_LIMIT:
        raise DamagedError(f"claims {length} bytes")
    try:
        file.seek(offset)
        data = file.read(length)
    except (OSError, ValueError, OverflowError, MemoryError) as error:
        raise DamagedError(f"cannot be read ({error})") from error
    if len(data) != length:
        raise DamagedError("is cut short")
    return data


def parse(opcode: int, body: bytes | memoryview) -> Record | None:
    """A record from its body, None if it is of no interest here."""
    kind = _CLASSES.get(Opcode(opcode)) if opcode in Opcode else None
    if kind is None:
        return None
    try:
        return kind.read(ReadDataStream(BytesIO(body)))
    except _DAMAGE as error:
        raise DamagedError(f"is damaged ({error})") from error


def split(data: bytes) -> Iterator[tuple[int, int, int]]:
    """Opcode, start and end of the body of every record in `data`."""
    at = 0
    while at < len(data):
        if at + RECORD_HEAD.size > len(data):
            raise DamagedError("ends within a record")
        opcode, length = RECORD_HEAD.unpack_from(data, at)
        at += RECORD_HEAD.size
        if length > len(data) - at:
            raise DamagedError("holds a record that is longer than itself")
        yield opcode, at, at + length
        at += length


def message_in(data: bytes, start: int, end: int) -> RecordedMessage:
    """The message record whose body is data[start:end]."""
    if end - start < _MESSAGE_HEAD.size:
        raise DamagedError("holds a message without a header")
    channel_id, _, log_time, publish_time = _MESSAGE_HEAD.unpack_from(data, start)
    return RecordedMessage(log_time, publish_time, channel_id, data[start + _MESSAGE_HEAD.size : end])


def unpacked(chunk: Chunk) -> bytes:
    """The records of a chunk, decompressed and checked against its size and CRC (0: it has none)."""
    size = chunk.uncompressed_size
    if size > RECORD_LIMIT:
        raise DamagedError(f"claims {size} bytes")
    try:
        data = _decompressed(chunk, size)
    except _DAMAGE as error:
        raise DamagedError(f"cannot be decompressed ({error})") from error
    if len(data) != size:
        raise DamagedError(f"holds {len(data)} bytes instead of {size}")
    if chunk.uncompressed_crc and zlib.crc32(data) != chunk.uncompressed_crc:
        raise DamagedError("has a wrong CRC")
    return data


def _decompressed(chunk: Chunk, size: int) -> bytes:
    """At most `size` + 1 bytes, so that no bomb goes off."""
    match chunk.compression:
        case "":
            return chunk.data
        case "lz4":
            return lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, max_length=size + 1)  # type: ignore[no-any-return]
        case "zstd":
            with zstandard.ZstdDecompressor().stream_reader(chunk.data, read_across_frames=True) as stream:
                return stream.read(size + 1)
    raise DamagedError(f"has the unknown compression {chunk.compression!r}")
