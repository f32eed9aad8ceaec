"""Recordings of ROS 1 and in sqlite3 that are damaged: which tool saves what is left of them."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import NamedTuple

ROS1_SUFFIXES = (".bag", ".bag.active")  # the latter is what a recorder that was killed leaves


class Storage(NamedTuple):
    """A format by the bytes it begins with. damage, remedy: complete "it", and a line; {name}: of the file.

    suffixes: of its files, the usual one first.
    """

    magic: bytes
    name: str
    suffixes: tuple[str, ...]
    damage: str
    remedy: str


ROS1 = Storage(b"#ROSBAG V", "a ROS 1 bag", ROS1_SUFFIXES, "is cut off or was not closed",
               "`rosbag reindex {name}` of ROS 1 makes an index of what is there")
SQLITE3 = Storage(b"SQLite format 3\0", "a recording in sqlite3", (".db3",), "is damaged or cut off",
                  '`sqlite3 {name} ".recover" | sqlite3 whole.db3` saves what is left (docs/inputs.md has another way)')


def storage_of(path: Path) -> Storage | None:
    """The format of a file; None: neither, or it cannot be read."""
    try:
        with path.open("rb") as file:
            start = file.read(max(len(ROS1.magic), len(SQLITE3.magic)))
    except OSError:
        return None
    return next((one for one in (ROS1, SQLITE3) if start.startswith(one.magic)), None)


def remedy_for(path: Path, storage: Storage) -> str:
    """What saves the rest of a damaged file."""
    return storage.remedy.format(name=shlex.quote(path.name))
