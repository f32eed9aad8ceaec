"""The contents of an MCAP file without a usable index: a scan over all its records."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from typing import IO

from mcap.opcode import Opcode

from stab_ros.core.text import are, counted
from stab_ros.io.mcap_contents import Block, McapContents, block_records, lost_part
from stab_ros.io.mcap_records import (
    MAGIC,
    NO_OPCODE,
    RECORD_HEAD,
    DamagedError,
    MessageOffsets,
    parse,
    read_exactly,
    split,
)

_RUN_LIMIT = 2**22  # bytes of messages outside of chunks that are read at a time


def scan(file: IO[bytes], size: int, warn: Callable[[str], None]) -> McapContents:
    """The contents of a file of `size` bytes. warn: is told of each damaged part."""
    return _Scan(file, size, warn).run()


class _Scan:
    def __init__(self, file: IO[bytes], size: int, warn: Callable[[str], None]) -> None:
        self._file, self._size, self._warn = file, size, warn
        self._contents = McapContents()

    def run(self) -> McapContents:
        run: tuple[int, int] | None = None  # offset and end of consecutive messages outside of chunks
        at = len(MAGIC)
        while at < self._size:
            opcode, end = self._head(at)
            if end > self._size or opcode == NO_OPCODE:  # a file system that crashed may leave zeros
                self._add_rest(opcode, at)
                break
            if run and (opcode != Opcode.MESSAGE or end - run[0] > _RUN_LIMIT):
                self._add_block(*run)
                run = None
            if opcode == Opcode.MESSAGE:
                run = (run[0] if run else at), end
            elif opcode == Opcode.CHUNK:
                self._add_block(at, end)
            elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                self._add_definition(at, end)
            elif opcode in (Opcode.ATTACHMENT, Opcode.METADATA):
                self._contents.extras.append((at, end - at))
            elif opcode in (Opcode.DATA_END, Opcode.FOOTER):
                break
            at = end
        if run:
            self._add_block(*run)
        blocks = self._contents.blocks
        if blocks:
            self._contents.span_ns = min(block.start_ns for block in blocks), max(block.end_ns for block in blocks)
        return self._contents

    def _head(self, at: int) -> tuple[int, int]:
        """Opcode and end of the record at this offset."""
        try:
            opcode, length = RECORD_HEAD.unpack(read_exactly(self._file, at, RECORD_HEAD.size))
        except DamagedError:
            opcode, length = NO_OPCODE, 0
        return opcode, at + RECORD_HEAD.size + length

    def _add_definition(self, at: int, end: int) -> None:
        try:
            body = read_exactly(self._file, at, end - at)
            self._contents.add_definition(parse(body[0], body[RECORD_HEAD.size :]))
        except DamagedError as damage:
            self._lost(at, str(damage))

    def _add_block(self, at: int, end: int) -> None:
        try:
            self._read_block(at, end)
        except DamagedError as damage:
            self._lost(at, str(damage))

    def _read_block(self, at: int, end: int, whole: bool = True) -> tuple[int, bool]:
        """How many messages it holds, and whether it is all there. whole: False: the file ends within it."""
        offsets, counts = MessageOffsets(), Counter[int]()
        data, _, is_all = block_records(self._file, Block(0, 0, at, end - at, frozenset(), whole))
        for opcode, start, stop in split(data, whole):
            if opcode == Opcode.MESSAGE:
                counts[offsets.add(data, start)] += 1
            else:
                self._contents.add_definition(parse(opcode, data[start:stop]))
        if counts:
            self._contents.counts.update(counts)
            self._contents.blocks.append(Block(*offsets.span_ns, at, end - at, frozenset(counts), whole))
        return len(offsets), is_all

    def _add_rest(self, opcode: int, at: int) -> None:
        """What there is of the record within which the file ends."""
        try:
            read, is_all = self._read_block(at, self._size, whole=False) if opcode == Opcode.CHUNK else (0, False)
        except DamagedError as damage:
            self._lost(at, f"is cut off and {damage}")
            return
        if not read:
            self._lost(at, "ends within a record")
            return
        fault, unchecked = ("has a wrong length, its", "") if is_all else (
            "is cut off, its first", " without the check of a CRC")
        self._warn(f"the part at byte {at} {fault} {counted(read, 'message')} {are(read)} read{unchecked}, "
                   "what follows is lost")

    def _lost(self, at: int, why: str) -> None:
        self._warn(lost_part(at, why))
