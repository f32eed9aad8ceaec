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
from mcap.records import Channel, ChunkIndex, Footer, Schema, Statistics

Record = Schema | Channel | ChunkIndex | Statistics | Footer
MAGIC = b"\x89MCAP0\r\n"
RECORD_HEAD = struct.Struct("<BQ")  # opcode, length
RECORD_LIMIT = 2**30  # bytes of one record or chunk, unpacked: 100 times a 4K frame
_MESSAGE_HEAD = struct.Struct("<HIQQ")  # channel, sequence, log time, publish time
_CHUNK_HEAD = struct.Struct("<QQQII")  # first and last log time, unpacked size, CRC, length of the compression's name
_CLASSES: dict[int, type[Record]] = {
    Opcode.SCHEMA: Schema,
    Opcode.CHANNEL: Channel,
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
    kind = _CLASSES.get(opcode)
    try:
        return None if kind is None else kind.read(ReadDataStream(BytesIO(body)))
    except _DAMAGE as error:
        raise DamagedError(f"is damaged ({error})") from error


def split(data: memoryview) -> Iterator[tuple[int, int, int]]:
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


def message_in(data: memoryview, start: int, end: int) -> RecordedMessage:
    """The message record whose body is data[start:end]."""
    if end - start < _MESSAGE_HEAD.size:
        raise DamagedError("holds a message without a header")
    channel_id, _, log_time, publish_time = _MESSAGE_HEAD.unpack_from(data, start)
    return RecordedMessage(log_time, publish_time, channel_id, bytes(data[start + _MESSAGE_HEAD.size : end]))


def unpacked(chunk: memoryview) -> memoryview:
    """The records in the body of a chunk record, decompressed and checked against their size and CRC (0: none)."""
    try:
        _, _, size, crc, name_length = _CHUNK_HEAD.unpack_from(chunk)
        start = _CHUNK_HEAD.size + name_length + 8
        compression = bytes(chunk[_CHUNK_HEAD.size : start - 8]).decode()
        (packed_size,) = struct.unpack_from("<Q", chunk, start - 8)
        data = _decompressed(chunk[start : start + packed_size], compression, size)
    except _DAMAGE as error:
        raise DamagedError(f"cannot be decompressed ({error})") from error
    if len(data) != size:
        raise DamagedError(f"does not hold the {size} bytes it claims")
    if crc and zlib.crc32(data) != crc:
        raise DamagedError("has a wrong CRC")
    return data


def _decompressed(packed: memoryview, compression: str, size: int) -> memoryview:
    """At most `size` + 1 bytes, so that no bomb goes off."""
    if size > RECORD_LIMIT:
        raise DamagedError(f"claims {size} bytes")
    match compression:
        case "":
            return packed
        case "lz4":
            return memoryview(lz4.frame.LZ4FrameDecompressor().decompress(packed, max_length=size + 1))
        case "zstd":
            with zstandard.ZstdDecompressor().stream_reader(packed, read_across_frames=True) as stream:
                return memoryview(stream.read(size + 1))
    raise DamagedError(f"has the unknown compression {compression!r}")
