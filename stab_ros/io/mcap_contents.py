"""What an MCAP file holds: its channels, schemas, blocks of messages and extras, however they were found."""

from __future__ import annotations

from collections import Counter
from typing import IO, NamedTuple

from mcap.opcode import Opcode
from mcap.records import Channel, Schema

from stab_ros.io.mcap_records import RECORD_HEAD, DamagedError, Record, read_exactly, unpacked

QOS_KEY, TYPE_HASH_KEY = "offered_qos_profiles", "topic_type_hash"  # of a channel's metadata, by rosbag2


class Block(NamedTuple):
    """A part of the file that holds messages: a chunk, or messages outside of chunks. Log times in ns.

    whole: False: the file ends within the chunk.
    """

    start_ns: int
    end_ns: int
    offset: int
    length: int
    channel_ids: frozenset[int]
    whole: bool = True


class McapContents:
    """channels, schemas: by id. counts: messages by channel id. blocks: in the order of the file.

    extras: offsets and lengths of attachments and metadata, in the order of the file.
    span_ns: log times of the first and the last message, None without messages.
    """

    def __init__(self) -> None:
        self.channels: dict[int, Channel] = {}
        self.schemas: dict[int, Schema] = {}
        self.counts: Counter[int] = Counter()
        self.blocks: list[Block] = []
        self.extras: list[tuple[int, int]] = []
        self.span_ns: tuple[int, int] | None = None

    def add_definition(self, record: Record | None) -> None:
        """Adds a channel or schema; other records are ignored."""
        if isinstance(record, Channel):
            self.channels[record.id] = record
        elif isinstance(record, Schema):
            self.schemas[record.id] = record


class Records(NamedTuple):
    """The records of a block. file_offset: where they begin in the file, None if they are compressed there.

    whole: all are there, and fit the CRC if there is one.
    """

    data: memoryview
    file_offset: int | None
    whole: bool = True


def block_records(file: IO[bytes], block: Block) -> Records:
    """The records of a block, decompressed.

    Raises:
        DamagedError: as `read_exactly`, or the block is neither a chunk nor messages.
    """
    data = memoryview(read_exactly(file, block.offset, block.length))
    if block.length > RECORD_HEAD.size and data[0] == Opcode.MESSAGE:
        return Records(data, block.offset)
    if not _is_chunk(data, block.whole):
        raise DamagedError("is not a chunk")
    unpacked_data, start, whole = unpacked(data[RECORD_HEAD.size :], block.whole)
    return Records(unpacked_data, None if start is None else block.offset + RECORD_HEAD.size + start, whole)


def _is_chunk(data: memoryview, whole: bool) -> bool:
    if len(data) <= RECORD_HEAD.size:
        return False
    opcode, length = RECORD_HEAD.unpack_from(data)
    return bool(opcode == Opcode.CHUNK and (length == len(data) - RECORD_HEAD.size or not whole))


def lost_part(offset: int, why: str) -> str:
    """That a part of the file is lost, as a warning says it."""
    return f"the part at byte {offset} {why}, its messages are lost"
