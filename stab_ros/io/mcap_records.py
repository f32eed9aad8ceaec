"""Records of an MCAP file, read defensively: no size is trusted before it is checked (https://mcap.dev/spec)."""

from __future__ import annotations

import struct
import zlib
from array import array
from collections.abc import Iterator
from io import BytesIO
from typing import IO, NamedTuple

import lz4.frame
import numpy as np
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import AttachmentIndex, Channel, ChunkIndex, Footer, MetadataIndex, Schema, Statistics
from numpy.typing import NDArray

Record = Schema | Channel | ChunkIndex | AttachmentIndex | MetadataIndex | Statistics | Footer
MAGIC = b"\x89MCAP0\r\n"
RECORD_HEAD = struct.Struct("<BQ")  # opcode, length
NO_OPCODE = 0
RECORD_LIMIT = 100 * 2**20  # bytes of one record or chunk, unpacked: an 8K frame in bgr8 has 99.5 million
_PIECE = 2**14  # bytes that are decompressed at a time, 255 times as many come out
_MOST_MESSAGES = 2**20  # in a block: a thousand times what a second holds
WINDOW_LIMIT = 2**25  # bytes of history that zstd may refer to; its level 19 asks for 2**23
_MESSAGE_HEAD = struct.Struct("<HIQQ")  # channel, sequence, log time, publish time
_CHUNK_HEAD = struct.Struct("<QQQII")  # first and last log time, unpacked size, CRC, length of the compression's name
_CLASSES: dict[int, type[Record]] = {
    Opcode.SCHEMA: Schema,
    Opcode.CHANNEL: Channel,
    Opcode.CHUNK_INDEX: ChunkIndex,
    Opcode.ATTACHMENT_INDEX: AttachmentIndex,
    Opcode.METADATA_INDEX: MetadataIndex,
    Opcode.STATISTICS: Statistics,
    Opcode.FOOTER: Footer,
}
# what mcap, lz4 and zstandard raise on damaged bytes
_DAMAGE = (McapError, struct.error, ValueError, RuntimeError, EOFError, MemoryError, zstandard.ZstdError)


class DamagedError(Exception):
    """Damaged bytes; the text completes a warning."""


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


def split(data: memoryview, whole: bool = True) -> Iterator[tuple[int, int, int]]:
    """Opcode, start and end of the body of every record in `data`.

    Raises:
        DamagedError: one is not whole, or a message without its header. With `whole` False it is where the records end.
    """
    try:
        yield from _split(data)
    except DamagedError:
        if whole:
            raise


def _split(data: memoryview) -> Iterator[tuple[int, int, int]]:
    at = 0
    while at < len(data):
        if at + RECORD_HEAD.size > len(data):
            raise DamagedError("ends within a record")
        opcode, length = RECORD_HEAD.unpack_from(data, at)
        at += RECORD_HEAD.size
        if opcode == NO_OPCODE:
            raise DamagedError("holds zeros where a record should begin")
        if length > len(data) - at:
            raise DamagedError("holds a record that is longer than itself")
        if opcode == Opcode.MESSAGE and length < _MESSAGE_HEAD.size:
            raise DamagedError("holds a message without a header")
        yield opcode, at, at + length
        at += length


class MessageOffsets:
    """Where messages lie in a block, a dozen bytes for each: a chunk may hold a million of them."""

    def __init__(self) -> None:
        self._times_ns, self._starts = array("Q"), array("I")

    def __len__(self) -> int:
        return len(self._times_ns)

    def add(self, data: memoryview, start: int) -> int:
        """The message record whose body begins there, as `split` has it; gives its channel."""
        if len(self) == _MOST_MESSAGES:
            raise DamagedError(f"holds more than {_MOST_MESSAGES} messages")
        channel_id, _, log_time_ns, _ = _MESSAGE_HEAD.unpack_from(data, start)
        self._times_ns.append(log_time_ns)
        self._starts.append(start)
        return int(channel_id)

    @property
    def span_ns(self) -> tuple[int, int]:
        return min(self._times_ns), max(self._times_ns)

    def before(self, time_ns: int) -> int:
        """How many messages are earlier."""
        return sum(log_time_ns < time_ns for log_time_ns in self._times_ns)

    def by_time(self) -> NDArray[np.uint32]:
        """Where the bodies begin, by log time."""
        if not len(self):
            return np.empty(0, np.uint32)
        times_ns, starts = np.frombuffer(self._times_ns, np.uint64), np.frombuffer(self._starts, np.uint32)
        in_order = bool(np.all(times_ns[1:] >= times_ns[:-1]))
        return starts if in_order else starts[np.argsort(times_ns, kind="stable")]


def message_at(data: memoryview, start: int) -> RecordedMessage:
    """The message record whose body begins there, as `MessageOffsets` has it."""
    _, length = RECORD_HEAD.unpack_from(data, start - RECORD_HEAD.size)
    channel_id, _, log_time, publish_time = _MESSAGE_HEAD.unpack_from(data, start)
    end = start + length
    return RecordedMessage(log_time, publish_time, channel_id, bytes(data[start + _MESSAGE_HEAD.size : end]))


def message_in(file: IO[bytes], offset: int) -> RecordedMessage:
    """The message record whose body begins there, read without a second copy in memory.

    Raises:
        DamagedError: as `read_exactly`.
    """
    _, length = RECORD_HEAD.unpack(read_exactly(file, offset - RECORD_HEAD.size, RECORD_HEAD.size))
    channel_id, _, log_time, publish_time = _MESSAGE_HEAD.unpack(read_exactly(file, offset, _MESSAGE_HEAD.size))
    data = read_exactly(file, offset + _MESSAGE_HEAD.size, length - _MESSAGE_HEAD.size)
    return RecordedMessage(log_time, publish_time, channel_id, data)


def unpacked(chunk: memoryview, whole: bool = True) -> tuple[memoryview, int | None, bool]:
    """The records in the body of a chunk record, where in it they begin, None: compressed, and whether all are there.

    If so, they are checked against their size and CRC (0: none). whole: False: the chunk may be cut off; then they are
    as many as come out, unchecked.

    Raises:
        DamagedError: they cannot be decompressed, or are others.
    """
    try:
        _, _, size, crc, name_length = _CHUNK_HEAD.unpack_from(chunk)
        start = _CHUNK_HEAD.size + name_length + 8
        compression = bytes(chunk[_CHUNK_HEAD.size : start - 8]).decode()
        (packed_size,) = struct.unpack_from("<Q", chunk, start - 8)
        packed = chunk[start : start + packed_size]
        whole = whole or len(packed) == packed_size
        data = _decompressed(packed, compression, size, whole)
    except _DAMAGE as error:
        raise DamagedError(f"cannot be decompressed ({error})") from error
    plain_start = None if compression else start
    if not whole:
        return data[:size], plain_start, False
    if len(data) != size:
        raise DamagedError(f"does not hold the {size} bytes it claims")
    if crc and zlib.crc32(data) != crc:
        raise DamagedError("has a wrong CRC")
    return data, plain_start, True


def _decompressed(packed: memoryview, compression: str, size: int, whole: bool) -> memoryview:
    """At most slightly more than `size` bytes, whatever a decompression bomb claims; whole: or what comes of a part."""
    if size > RECORD_LIMIT:
        raise DamagedError(f"claims {size} bytes")
    match compression:
        case "":
            return packed
        case "lz4":
            return memoryview(_lz4_decompressed(packed, size))
        case "zstd" if whole and zstandard.frame_content_size(packed) == size:  # at once, which needs no window
            return memoryview(zstandard.ZstdDecompressor().decompress(packed))
        case "zstd":
            unpacker = zstandard.ZstdDecompressor(max_window_size=WINDOW_LIMIT)
            with unpacker.stream_reader(packed, read_across_frames=True) as stream:
                return memoryview(stream.read(size + 1))
    raise DamagedError(f"has the unknown compression {compression!r}")


def _lz4_decompressed(packed: memoryview, size: int) -> bytearray:
    """Piece by piece: at once, the library would hold all of it twice."""
    unpacker, data = lz4.frame.LZ4FrameDecompressor(), bytearray()
    for at in range(0, len(packed), _PIECE):
        data += unpacker.decompress(packed[at : at + _PIECE])
        if unpacker.eof or len(data) > size:
            break
    return data
