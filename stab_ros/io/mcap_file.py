"""One MCAP file, open for reading, intact or damaged."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from mcap.opcode import Opcode

from stab_ros.core.errors import InputError
from stab_ros.core.text import counted
from stab_ros.io.mcap_contents import Block, McapContents, block_records, lost_part
from stab_ros.io.mcap_extras import Extra, read_extra
from stab_ros.io.mcap_index import read_index
from stab_ros.io.mcap_records import (
    MAGIC,
    DamagedError,
    MessageOffsets,
    RecordedMessage,
    message_at,
    message_in,
    read_exactly,
    split,
)
from stab_ros.io.mcap_scan import scan
from stab_ros.io.other_storage import remedy_for, storage_of

_LARGE = 2**24  # bytes of a block that is not kept in memory beside its messages


class McapFile:
    """contents: from the index or, where that is missing or damaged, from a scan of the file.

    Raises:
        InputError: it cannot be opened or is not an MCAP file.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._warned: dict[str, None] = {}  # a set in order
        if not path.is_file():
            raise InputError(f"{path}: no such file, it must be a readable MCAP file")
        try:
            self._file = path.open("rb")
        except OSError as error:
            raise InputError(f"{path}: {error.strerror or error}, it must be a readable MCAP file") from error
        try:
            self._size = self._file.seek(0, 2)
            self._check_magic()
            self.contents = self._read_contents()
        except BaseException:
            self._file.close()
            raise

    def close(self) -> None:
        self._file.close()

    @property
    def warnings(self) -> list[str]:
        """What could not be read, one line each."""
        return list(self._warned)

    def _check_magic(self) -> None:
        if self._size == 0:
            raise InputError(f"{self.path}: is empty, it must be an MCAP file")
        try:
            magic = read_exactly(self._file, 0, len(MAGIC))
        except DamagedError as damage:
            raise InputError(f"{self.path}: {damage}, it must be an MCAP file") from damage
        storage = storage_of(self.path)
        if storage is not None:
            named = self.path.name.lower().endswith(storage.suffixes)
            to_do = "" if named else f"its name must end in {storage.suffixes[0]}; "
            raise InputError(f"{self.path}: is {storage.name}, not an MCAP file; {to_do}if it {storage.damage}, "
                             f"{remedy_for(self.path, storage)}")
        if magic != MAGIC:
            raise InputError(f"{self.path}: is not an MCAP file, it must begin with the bytes 89 4D 43 41 50 30 0D 0A")

    def _read_contents(self) -> McapContents:
        try:
            indexed = read_index(self._file, self._size)
        except DamagedError as damage:
            self._warn(f"the index {damage}, the whole file was scanned instead")
            indexed = None
        return indexed or scan(self._file, self._size, self._warn)

    def extras(self) -> Iterator[Extra]:
        """The attachments and metadata; damaged ones are left out, with a warning."""
        for offset, length in self.contents.extras:
            try:
                yield read_extra(self._file, offset, length)
            except DamagedError as damage:
                self._warn(f"the attachment or metadata at byte {offset} {damage}, it is left out")

    def messages_of(self, block: Block) -> Iterator[RecordedMessage]:
        """The messages of a block by log time; of a damaged one none, with a warning."""
        offsets = MessageOffsets()
        try:
            data, in_file, _ = block_records(self._file, block)
            for opcode, start, _ in split(data, block.whole):
                if opcode == Opcode.MESSAGE:
                    offsets.add(data, start)
        except DamagedError as damage:
            self._lost(block.offset, str(damage))
            return
        early = offsets.before(block.start_ns)
        if early:  # only an index without a CRC can be so wrong
            self._warn(f"the part at byte {block.offset} holds {counted(early, 'message')} from before the time "
                       "that the index gives, they are left out")
        starts = offsets.by_time()[early:]
        if block.length > _LARGE and in_file is not None:
            del data
            yield from self._read_again(block, [in_file + int(start) for start in starts])
        else:
            yield from (message_at(data, int(start)) for start in starts)

    def _read_again(self, block: Block, starts: list[int]) -> Iterator[RecordedMessage]:
        """One message after the other, as a large block and its messages would take twice the memory."""
        try:
            for start in starts:
                yield message_in(self._file, start)
        except DamagedError as damage:  # a disk that fails
            self._lost(block.offset, str(damage))

    def _lost(self, offset: int, why: str) -> None:
        self._warn(lost_part(offset, why))

    def _warn(self, what: str) -> None:
        self._warned[f"{self.path}: {what}"] = None
