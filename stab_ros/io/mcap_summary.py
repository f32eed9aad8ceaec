"""The end of an MCAP file that holds attachments or metadata which the mcap library has not written itself."""

from __future__ import annotations

import zlib
from collections.abc import Iterable, Mapping, Sequence
from io import BytesIO

from mcap.data_stream import ReadDataStream, RecordBuilder
from mcap.opcode import Opcode
from mcap.records import AttachmentIndex, DataEnd, Footer, McapRecord, MetadataIndex, Statistics, SummaryOffset

from stab_ros.io.mcap_records import MAGIC, RECORD_HEAD, split

_CRC_BYTES = 4


def end_with_extras(end: bytes, offset: int, extras: Sequence[AttachmentIndex | MetadataIndex]) -> bytes:
    """What takes the place of `end`, the bytes from the data end on, which the library has written at `offset`."""
    groups = {opcode: bytearray() for opcode in (
        Opcode.SCHEMA, Opcode.CHANNEL, Opcode.STATISTICS, Opcode.CHUNK_INDEX)}
    for opcode, start, stop in split(memoryview(end)[: -len(MAGIC)]):
        if opcode == Opcode.STATISTICS:
            groups[Opcode.STATISTICS] += _recounted(end[start:stop], extras)
        elif opcode in groups:
            groups[Opcode(opcode)] += end[start - RECORD_HEAD.size : stop]
    for opcode, kind in ((Opcode.ATTACHMENT_INDEX, AttachmentIndex), (Opcode.METADATA_INDEX, MetadataIndex)):
        groups[opcode] = bytearray(_records(index for index in extras if isinstance(index, kind)))
    data_end = _records([DataEnd(data_section_crc=0)])
    return data_end + _summary(groups, offset + len(data_end)) + MAGIC


def _recounted(body: bytes, extras: Sequence[AttachmentIndex | MetadataIndex]) -> bytes:
    statistics = Statistics.read(ReadDataStream(BytesIO(body)))
    statistics.attachment_count = sum(isinstance(index, AttachmentIndex) for index in extras)
    statistics.metadata_count = len(extras) - statistics.attachment_count
    return _records([statistics])


def _summary(groups: Mapping[Opcode, bytearray], start: int) -> bytes:
    """The groups, where each lies, and the footer."""
    summary, offsets = bytearray(), list[SummaryOffset]()
    for opcode, group in groups.items():
        offsets.append(SummaryOffset(group_opcode=opcode, group_start=start + len(summary), group_length=len(group)))
        summary += group
    offset_start = start + len(summary)
    summary += _records(offsets)
    unsigned = _records([Footer(summary_start=start, summary_offset_start=offset_start, summary_crc=0)])[:-_CRC_BYTES]
    return b"".join((summary, unsigned, zlib.crc32(unsigned, zlib.crc32(summary)).to_bytes(_CRC_BYTES, "little")))


def _records(records: Iterable[McapRecord]) -> bytes:
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    return bytes(builder.end())
