"""Recovers a damaged MCAP file: every complete chunk with a correct CRC."""

from __future__ import annotations

from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

from stab_ros.core.errors import InputError
from stab_ros.core.text import reasons
from stab_ros.io.bag_writer import BagWriter
from stab_ros.io.mcap_reader import McapReader


@dataclass(frozen=True)
class Recovered:
    """The result of a recovery. warnings: what was lost, one line each."""

    messages: int
    topics: int
    warnings: tuple[str, ...]


def recover(broken: Path, fixed: Path, overwrite: bool = False) -> Recovered:
    """Copies all that is readable in the MCAP file `broken`, byte for byte, messages by log time, into the new `fixed`.

    Raises:
        InputError: `broken` is no MCAP file or holds no readable message, `fixed` exists or cannot be written.
        WorkError: the disk is full.
    """
    if fixed.exists() and fixed.samefile(broken):
        raise InputError(f"{fixed}: is the damaged file itself, the output must be another file")
    with closing(McapReader([broken])) as reader, BagWriter(fixed, overwrite) as writer:
        for topic in reader.topics.values():
            writer.add_topic(topic)
        extras = list(reader.extras())
        writer.add_extras(extras)
        count = 0
        for message in reader.messages():
            writer.write(*message)
            count += 1
        if count == 0 and not extras:
            why = reasons(str(broken), reader.warnings) or " (it is whole but empty)"
            raise InputError(f"{broken}: nothing to recover, it must hold at least one readable message{why}")
        return Recovered(count, len(reader.topics), tuple(reader.warnings))
