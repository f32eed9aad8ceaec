"""The blocks of a SubRip file (.srt), as far as they can be told from each other; any part of one may be missing."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field

_NUMBER = re.compile(r"\s*\d{1,9}\s*")
_TIMES = re.compile(r"\s*(\d{1,3}):(\d{1,2}):(\d{1,2})[,.](\d{1,3})\s*-->")


@dataclass
class Block:
    """A block. start_ns: of its time code; text: its lines, each with the end of the line where it has one."""

    start_ns: int | None = None
    lines: list[str] = field(default_factory=list)

    @property
    def text(self) -> str:
        return "".join(self.lines)


def srt_blocks(text: str) -> Iterator[Block]:
    """A block begins with a line that is a number, and with a time code where that line is missing."""
    block = Block()
    for line in text.splitlines(keepends=True):
        times = _TIMES.match(line)
        if _NUMBER.fullmatch(line) or (times and (block.start_ns is not None or block.lines)):
            if block.start_ns is not None or block.lines:
                yield block
            block = Block()
        if times:
            hours, minutes, seconds, fraction = times.groups()
            whole = (int(hours) * 60 + int(minutes)) * 60 + int(seconds)
            block.start_ns = (whole * 1000 + int(fraction.ljust(3, "0"))) * 1_000_000
        elif line.strip() and not _NUMBER.fullmatch(line):
            block.lines.append(line)
    if block.start_ns is not None or block.lines:
        yield block
