"""The contents of an MCAP file from the index (summary section) at its end."""

from __future__ import annotations

import zlib
from collections.abc import Iterable, Iterator
from typing import IO

from mcap.opcode import Opcode
from mcap.records import AttachmentIndex, ChunkIndex, Footer, MetadataIndex, Statistics

from stab_ros.io.mcap_contents import Block, McapContents
from stab_ros.io.mcap_records import MAGIC, RECORD_HEAD, DamagedError, Record, parse, read_exactly, split

_FOOTER_LENGTH = 20
_TAIL = RECORD_HEAD.size + _FOOTER_LENGTH + len(MAGIC)


def read_index(file: IO[bytes], size: int) -> McapContents | None:
    """The contents that the index of a file of `size` bytes lists; None: it has no index, or an incomplete one.

    Raises:
        DamagedError: the index is damaged, or the file was cut off.
    """
    tail = read_exactly(file, max(size - _TAIL, 0), min(_TAIL, size))
    if len(tail) < _TAIL or not tail.endswith(MAGIC) or tail[0] != Opcode.FOOTER:
        raise DamagedError(f"is missing, the recording was cut off at byte {size}")
    footer = parse(Opcode.FOOTER, tail[RECORD_HEAD.size : -len(MAGIC)])
    if not isinstance(footer, Footer) or footer.summary_start == 0:
        return None
    start, end = footer.summary_start, size - _TAIL
    if not len(MAGIC) <= start <= end:
        raise DamagedError(f"at byte {start} lies outside of the file")
    try:
        summary = read_exactly(file, start, end - start)
        crc = zlib.crc32(tail[: RECORD_HEAD.size + _FOOTER_LENGTH - 4], zlib.crc32(summary))
        if footer.summary_crc not in (0, crc):
            raise DamagedError("has a wrong CRC")
        return _contents(_records(memoryview(summary)), start)
    except DamagedError as damage:
        raise DamagedError(f"at byte {start} {damage}") from damage


def _records(data: memoryview) -> Iterator[Record]:
    """All records in `data` but messages."""
    for opcode, start, end in split(data):
        record = None if opcode == Opcode.MESSAGE else parse(opcode, data[start:end])
        if record is not None:
            yield record


def _contents(records: Iterable[Record], messages_end: int) -> McapContents | None:
    """`messages_end`: the byte where the messages of the file end."""
    contents, statistics = McapContents(), None
    for record in records:
        contents.add_definition(record)
        if isinstance(record, Statistics):
            statistics = record
        elif isinstance(record, ChunkIndex):
            contents.blocks.append(_block_of(record))
        elif isinstance(record, AttachmentIndex | MetadataIndex):
            contents.extras.append((record.offset, record.length))
    if statistics is None or not _is_complete(contents, statistics):
        return None
    contents.counts.update(statistics.channel_message_counts)
    if statistics.message_count:
        contents.span_ns = statistics.message_start_time, statistics.message_end_time
    contents.blocks.sort(key=lambda block: block.offset)
    contents.extras.sort()
    _check_disjoint([(block.offset, block.length) for block in contents.blocks], messages_end)
    _check_disjoint(contents.extras, messages_end)
    return contents


def _is_complete(contents: McapContents, statistics: Statistics) -> bool:
    """A writer may leave out any part of the summary, and messages outside of chunks have no index."""
    defined = all(channel.schema_id in (0, *contents.schemas) for channel in contents.channels.values())
    counted = statistics.channel_message_counts.keys() <= contents.channels.keys()
    indexed = len(contents.blocks) == statistics.chunk_count and (
        bool(contents.blocks) or statistics.message_count == 0)
    listed = len(contents.extras) == statistics.attachment_count + statistics.metadata_count
    return defined and counted and indexed and listed


def _check_disjoint(parts: Iterable[tuple[int, int]], messages_end: int) -> None:
    """A part, by offset and length, that is listed again and again would be read again and again."""
    at = len(MAGIC)
    for offset, length in parts:
        if offset < at:
            raise DamagedError(f"lists parts that overlap at byte {offset}")
        at = offset + length
    if at > messages_end:
        raise DamagedError(f"lists a part that ends beyond it, at byte {at}")


def _block_of(index: ChunkIndex) -> Block:
    return Block(index.message_start_time, index.message_end_time, index.chunk_start_offset, index.chunk_length,
                 frozenset(index.message_index_offsets))
