"""One MCAP file: where its messages are, by its index or, where that is missing or damaged, by a scan of the file."""

from __future__ import annotations

import zlib
from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

from mcap.opcode import Opcode
from mcap.records import Channel, ChunkIndex, Footer, Schema, Statistics

from stab_ros.core.errors import InputError
from stab_ros.io.mcap_records import (
    MAGIC,
    NO_OPCODE,
    PLAIN_START,
    RECORD_HEAD,
    DamagedError,
    Places,
    Record,
    RecordedMessage,
    message_at,
    message_in,
    parse,
    read_exactly,
    split,
    unpacked,
)

_FOOTER_LENGTH = 20
_TAIL = RECORD_HEAD.size + _FOOTER_LENGTH + len(MAGIC)
_LARGE = 2**24  # bytes of a block that is not kept in memory beside its messages
_RUN_LIMIT = 2**22  # bytes of messages outside of chunks that are read at a time


class Block(NamedTuple):
    """A piece of the file that holds messages: a chunk, or messages that were written without one."""

    start_ns: int
    end_ns: int
    offset: int
    length: int
    channel_ids: frozenset[int]


class McapFile:
    """channels, schemas: by id. counts: messages by channel id. blocks: in the order of the file.

    span_ns: log times of the first and the last message, None without messages.

    Raises:
        InputError: it cannot be opened or is not an MCAP file.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._warned: dict[str, None] = {}  # a set in order
        self._clear()
        if not path.is_file():
            raise InputError(f"{path}: no such file, it must be a readable MCAP file")
        try:
            self._file = path.open("rb")
        except OSError as error:
            raise InputError(f"{path}: {error.strerror or error}, it must be a readable MCAP file") from error
        try:
            self._size = self._file.seek(0, 2)
            self._check_magic()
            self._find_blocks()
        except BaseException:
            self._file.close()
            raise

    def close(self) -> None:
        self._file.close()

    @property
    def warnings(self) -> list[str]:
        """What could not be read, one line each."""
        return list(self._warned)

    def _clear(self) -> None:
        self.channels: dict[int, Channel] = {}
        self.schemas: dict[int, Schema] = {}
        self.counts: Counter[int] = Counter()
        self.blocks: list[Block] = []
        self.span_ns: tuple[int, int] | None = None

    def _check_magic(self) -> None:
        if self._size == 0:
            raise InputError(f"{self.path}: is empty, it must be an MCAP file")
        try:
            magic = read_exactly(self._file, 0, len(MAGIC))
        except DamagedError as damage:
            raise InputError(f"{self.path}: {damage}, it must be an MCAP file") from damage
        if magic != MAGIC:
            raise InputError(f"{self.path}: is not an MCAP file, it must begin with the bytes 89 4D 43 41 50 30 0D 0A")

    def _find_blocks(self) -> None:
        try:
            indexed = self._read_index()
        except DamagedError as damage:
            self._warned[f"{self.path}: the index {damage}, the whole file was scanned instead"] = None
            indexed = False
        if not indexed:
            self._clear()
            self._scan()

    # the index -------------------------------------------------------------------------------------------------------
    def _read_index(self) -> bool:
        """False: the file is whole, but was written without one. Raises DamagedError where it cannot be trusted."""
        tail = read_exactly(self._file, max(self._size - _TAIL, 0), min(_TAIL, self._size))
        if len(tail) < _TAIL or not tail.endswith(MAGIC) or tail[0] != Opcode.FOOTER:
            raise DamagedError(f"is missing, the recording was cut off at byte {self._size}")
        footer = parse(Opcode.FOOTER, tail[RECORD_HEAD.size : -len(MAGIC)])
        if not isinstance(footer, Footer) or footer.summary_start == 0:
            return False
        start, end = footer.summary_start, self._size - _TAIL
        if not len(MAGIC) <= start <= end:
            raise DamagedError(f"at byte {start} lies outside of the file")
        try:
            summary = read_exactly(self._file, start, end - start)
            crc = zlib.crc32(tail[: RECORD_HEAD.size + _FOOTER_LENGTH - 4], zlib.crc32(summary))
            if footer.summary_crc not in (0, crc):
                raise DamagedError("has a wrong CRC")
            return self._take_summary(_records(memoryview(summary)), start)
        except DamagedError as damage:
            raise DamagedError(f"at byte {start} {damage}") from damage

    def _take_summary(self, records: Iterable[Record], end: int) -> bool:
        """`end`: where the messages of the file end."""
        statistics: Statistics | None = None
        for record in records:
            self._take_definition(record)
            if isinstance(record, Statistics):
                statistics = record
            elif isinstance(record, ChunkIndex):
                self.blocks.append(_block_of(record))
        if statistics is None or not self._is_complete(statistics):
            return False
        self.counts.update(statistics.channel_message_counts)
        if statistics.message_count:
            self.span_ns = statistics.message_start_time, statistics.message_end_time
        self.blocks.sort(key=lambda block: block.offset)
        at = len(MAGIC)
        for block in self.blocks:  # one chunk that is listed again and again would be read again and again
            if block.offset < at:
                raise DamagedError(f"lists chunks that overlap at byte {block.offset}")
            at = block.offset + block.length
        if at > end:
            raise DamagedError(f"lists a chunk that ends beyond it, at byte {at}")
        return True

    def _is_complete(self, statistics: Statistics) -> bool:
        """Whether the summary tells all; a writer may leave out any part, and messages without chunks have no index."""
        defined = all(channel.schema_id in (0, *self.schemas) for channel in self.channels.values())
        counted = statistics.channel_message_counts.keys() <= self.channels.keys()
        indexed = len(self.blocks) == statistics.chunk_count and (bool(self.blocks) or statistics.message_count == 0)
        return defined and counted and indexed

    def _take_definition(self, record: Record | None) -> None:
        if isinstance(record, Channel):
            self.channels[record.id] = record
        elif isinstance(record, Schema):
            self.schemas[record.id] = record

    # the scan --------------------------------------------------------------------------------------------------------
    def _scan(self) -> None:
        """Goes through all records; what is damaged is left out with a warning."""
        run: tuple[int, int] | None = None  # offset and end of consecutive messages outside of chunks
        at = len(MAGIC)
        while at < self._size:
            try:
                opcode, length = RECORD_HEAD.unpack(read_exactly(self._file, at, RECORD_HEAD.size))
            except DamagedError:
                opcode, length = NO_OPCODE, 0
            end = at + RECORD_HEAD.size + length
            if end > self._size or opcode == NO_OPCODE:  # a file system that crashed may leave zeros
                self._lost(at, "ends within a record")
                break
            if run and (opcode != Opcode.MESSAGE or end - run[0] > _RUN_LIMIT):
                self._scan_block(*run)
                run = None
            if opcode == Opcode.MESSAGE:
                run = (run[0] if run else at), end
            elif opcode == Opcode.CHUNK:
                self._scan_block(at, end)
            elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                self._scan_definition(at, end)
            elif opcode in (Opcode.DATA_END, Opcode.FOOTER):
                break
            at = end
        if run:
            self._scan_block(*run)
        if self.blocks:
            self.span_ns = min(block.start_ns for block in self.blocks), max(block.end_ns for block in self.blocks)

    def _scan_definition(self, at: int, end: int) -> None:
        try:
            body = read_exactly(self._file, at, end - at)
            self._take_definition(parse(body[0], body[RECORD_HEAD.size :]))
        except DamagedError as damage:
            self._lost(at, str(damage))

    def _scan_block(self, at: int, end: int) -> None:
        places, counts = Places(), Counter[int]()
        try:
            data = self._data(at, end - at)
            for opcode, start, stop in split(data):
                if opcode == Opcode.MESSAGE:
                    counts[places.add(data, start, stop)] += 1
                else:
                    self._take_definition(parse(opcode, data[start:stop]))
        except DamagedError as damage:
            self._lost(at, str(damage))
            return
        if counts:
            self.counts.update(counts)
            self.blocks.append(Block(*places.span_ns, at, end - at, frozenset(counts)))

    # the messages ----------------------------------------------------------------------------------------------------
    def messages_of(self, block: Block) -> Iterator[RecordedMessage]:
        """The messages of a block by log time; of a damaged one none, with a warning."""
        places = Places()
        try:
            data = self._data(block.offset, block.length)
            for opcode, start, end in split(data):
                if opcode == Opcode.MESSAGE:
                    places.add(data, start, end)
        except DamagedError as damage:
            self._lost(block.offset, str(damage))
            return
        early = places.before(block.start_ns)
        if early:  # only an index without a CRC can be so wrong
            self._warned[f"{self.path}: the part at byte {block.offset} holds {early} messages from before the time "
                         "that the index gives, they are left out"] = None
        starts = places.by_time()[early:]
        if block.length > _LARGE and len(data) + PLAIN_START >= block.length:  # it is not compressed
            base = block.offset + (0 if len(data) == block.length else PLAIN_START)
            del data
            yield from self._read_again(block, [base + int(start) for start in starts])
        else:
            yield from (message_at(data, int(start)) for start in starts)

    def _read_again(self, block: Block, places: list[int]) -> Iterator[RecordedMessage]:
        """One message after the other, as a large block and its messages would take twice the memory."""
        try:
            for at in places:
                yield message_in(self._file, at)
        except DamagedError as damage:  # a disk that fails
            self._lost(block.offset, str(damage))

    def _data(self, offset: int, length: int) -> memoryview:
        """The records of a block."""
        data = memoryview(read_exactly(self._file, offset, length))
        if length > RECORD_HEAD.size and data[0] == Opcode.MESSAGE:
            return data
        if length <= RECORD_HEAD.size or RECORD_HEAD.unpack_from(data) != (Opcode.CHUNK, length - RECORD_HEAD.size):
            raise DamagedError("is not a chunk")
        return unpacked(data[RECORD_HEAD.size :])

    def _lost(self, offset: int, why: str) -> None:
        self._warned[f"{self.path}: the part at byte {offset} {why}, its messages are lost"] = None


def _records(data: memoryview) -> Iterator[Record]:
    """All records in `data` but messages."""
    for opcode, start, end in split(data):
        record = None if opcode == Opcode.MESSAGE else parse(opcode, data[start:end])
        if record is not None:
            yield record


def _block_of(index: ChunkIndex) -> Block:
    return Block(index.message_start_time, index.message_end_time, index.chunk_start_offset, index.chunk_length,
                 frozenset(index.message_index_offsets))
