"""What an MCAP file holds besides messages: attachments and metadata, read so that they can be copied byte for byte."""

from __future__ import annotations

import hashlib
import zlib
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import IO

from mcap.opcode import Opcode
from mcap.records import AttachmentIndex, MetadataIndex

from stab_ros.core.errors import WorkError
from stab_ros.io.mcap_records import RECORD_HEAD, DamagedError, read_exactly

_PIECE = 2**20  # bytes that are copied at a time: an attachment may be as large as a video
_HEAD_LIMIT = 2**16  # bytes of the fields of an attachment before its data
_METADATA_LIMIT = 2**24  # bytes of a metadata record
_CRC_BYTES = 4


@dataclass(frozen=True)
class Extra:
    """An attachment or a metadata record.

    index: as a summary lists it; its offset is that in the file it comes from. digest: of all its bytes.
    pieces: yields the record, from its opcode on; raises WorkError if it cannot be read any more.
    """

    index: AttachmentIndex | MetadataIndex
    digest: bytes
    pieces: Callable[[], Iterator[bytes]]

    def __str__(self) -> str:
        if isinstance(self.index, MetadataIndex):
            return f"metadata {self.index.name}"
        return f"attachment {self.index.name}: {self.index.media_type}, {self.index.data_size} bytes"


def read_extra(file: IO[bytes], offset: int, length: int) -> Extra:
    """The extra in the `length` bytes at `offset`, checked as a whole.

    Raises:
        DamagedError: it is damaged, or something else.
    """
    opcode, body_length = RECORD_HEAD.unpack(read_exactly(file, offset, RECORD_HEAD.size))
    if opcode not in (Opcode.ATTACHMENT, Opcode.METADATA) or body_length != length - RECORD_HEAD.size:
        raise DamagedError("is something else than the index says")
    index = _attachment(file, offset, length) if opcode == Opcode.ATTACHMENT else _metadata(file, offset, length)
    digest = hashlib.sha256()
    for piece in _pieces(file, offset, length):
        digest.update(piece)
    return Extra(index, digest.digest(), lambda: _again(file, offset, length))


def each_once(parts: Iterable[Iterable[Extra]]) -> Iterator[Extra]:
    """The extras of all parts of a recording; what an earlier part holds does not come again."""
    known = set[bytes]()
    for part in parts:
        found = [extra for extra in part if extra.digest not in known]
        known.update(extra.digest for extra in found)
        yield from found


class _Fields:
    """The fields in `data`, one after the other."""

    def __init__(self, data: bytes) -> None:
        self._data, self.at = data, 0

    def number(self, size: int) -> int:
        return int.from_bytes(self._take(size), "little")

    def text(self) -> str:
        try:
            return self._take(self.number(4)).decode()
        except UnicodeDecodeError as error:
            raise DamagedError("holds text that is not UTF-8") from error

    def _take(self, size: int) -> bytes:
        start, self.at = self.at, self.at + size
        if self.at > len(self._data):
            raise DamagedError("holds a text that is longer than it may be")
        return self._data[start : self.at]


def _attachment(file: IO[bytes], offset: int, length: int) -> AttachmentIndex:
    body_length = length - RECORD_HEAD.size
    fields = _Fields(read_exactly(file, offset + RECORD_HEAD.size, min(body_length, _HEAD_LIMIT)))
    log_time_ns, create_time_ns = fields.number(8), fields.number(8)
    name, media_type, size = fields.text(), fields.text(), fields.number(8)
    if fields.at + size + _CRC_BYTES != body_length:
        raise DamagedError(f"does not hold the {size} bytes it claims")
    _check_crc(file, offset, length)
    return AttachmentIndex(offset=offset, length=length, log_time=log_time_ns, create_time=create_time_ns,
                           data_size=size, name=name, media_type=media_type)


def _metadata(file: IO[bytes], offset: int, length: int) -> MetadataIndex:
    if length > _METADATA_LIMIT:
        raise DamagedError(f"claims {length} bytes")
    fields = _Fields(read_exactly(file, offset + RECORD_HEAD.size, length - RECORD_HEAD.size))
    name = fields.text()
    end = fields.number(4) + fields.at
    while fields.at < end:
        fields.text(), fields.text()  # a name and its value
    if fields.at != end:
        raise DamagedError("holds a text that is longer than it may be")
    return MetadataIndex(offset=offset, length=length, name=name)


def _check_crc(file: IO[bytes], offset: int, length: int) -> None:
    """Of an attachment; zero stands for none."""
    expected = int.from_bytes(read_exactly(file, offset + length - _CRC_BYTES, _CRC_BYTES), "little")
    found = 0
    for piece in _pieces(file, offset + RECORD_HEAD.size, length - RECORD_HEAD.size - _CRC_BYTES if expected else 0):
        found = zlib.crc32(piece, found)
    if found != expected:
        raise DamagedError("has a wrong CRC")


def _pieces(file: IO[bytes], offset: int, length: int) -> Iterator[bytes]:
    for at in range(offset, offset + length, _PIECE):
        yield read_exactly(file, at, min(_PIECE, offset + length - at))


def _again(file: IO[bytes], offset: int, length: int) -> Iterator[bytes]:
    try:
        yield from _pieces(file, offset, length)
    except DamagedError as damage:  # a disk that fails
        raise WorkError(f"{file.name}: the part at byte {offset} {damage}, it must stay readable") from damage
