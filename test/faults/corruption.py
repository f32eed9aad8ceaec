"""Reads damaged recordings in one process and prints what came of each: `python corruption.py TASKS`, a JSON file.

A task is a file to read and, for one that is still to be damaged, the sound file, the kind of damage and a seed.
"""

from __future__ import annotations

import json
import random
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from stab_ros.core.errors import InputError
from stab_ros.io.bag import Message, open_bag
from stab_ros.io.compressed_image import decode_file
from stab_ros.io.mcap_records import MAGIC, RECORD_HEAD

HUGE = (2**31, 2**32 - 1, 2**40, 2**62, 2**63, 2**64 - 1)
_BLOCK = 4096  # bytes, of a disk


@dataclass(frozen=True)
class ReadOutcome:
    """honest: only recorded messages, each once and in order. error: "" if the file was read."""

    task: dict[str, Any]
    error: str
    warnings: list[str]
    messages: int
    lost: int
    honest: bool
    seconds: float
    peak_mb: float


# damage ---------------------------------------------------------------------------------------------------------------
def _truncated(data: bytearray, rng: random.Random) -> None:
    del data[rng.randrange(len(data)) :]


def _flipped(data: bytearray, rng: random.Random) -> None:
    data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)


def _garbage(data: bytearray, rng: random.Random) -> None:
    at = rng.randrange(len(data))
    length = rng.randrange(1, _BLOCK)
    data[at : at + length] = rng.randbytes(min(length, len(data) - at))


def _zeros(data: bytearray, rng: random.Random) -> None:
    """As a disk that has lost a block."""
    at = rng.randrange(len(data) // _BLOCK + 1) * _BLOCK
    data[at : at + _BLOCK] = bytes(min(_BLOCK, len(data) - at))


def _huge(data: bytearray, rng: random.Random) -> None:
    """The length of a record, or what a chunk says of its own size."""
    at = rng.choice(list(_records(data)))
    field = at + 1 if rng.random() < 0.5 else at + RECORD_HEAD.size + rng.choice((0, 8, 16, 24, 28, 32))
    data[field : field + 8] = rng.choice(HUGE).to_bytes(8, "little")


def _records(data: bytearray) -> Iterator[int]:
    at = len(MAGIC)
    while at + RECORD_HEAD.size + len(MAGIC) <= len(data):
        yield at
        at += RECORD_HEAD.size + RECORD_HEAD.unpack_from(data, at)[1]


KINDS: dict[str, Callable[[bytearray, random.Random], None]] = {
    "truncated": _truncated, "flipped": _flipped, "garbage": _garbage, "zeros": _zeros, "huge": _huge}


# reading --------------------------------------------------------------------------------------------------------------
def read(path: Path) -> tuple[list[Message], list[str]]:
    if path.suffix in (".png", ".jpg"):
        decode_file(np.fromfile(path, np.uint8))
        return [], []
    with open_bag(path) as reader:
        return list(reader.messages()), list(reader.warnings)


def outcome(task: dict[str, Any], expected: list[Message]) -> ReadOutcome:
    path = Path(task["path"])
    began_s = time.monotonic()
    error, messages, warnings = "", list[Message](), list[str]()
    try:
        messages, warnings = read(path)
    except InputError as refused:
        error = str(refused)
    seconds = time.monotonic() - began_s
    remaining = iter(expected)
    honest = all(message in remaining for message in messages)
    return ReadOutcome(task, error, warnings, len(messages), len(expected) - len(messages), honest, seconds, peak_mb())


def peak_mb() -> float:
    """Of this process since it began."""
    status = Path("/proc/self/status").read_text(encoding="ascii")
    return int(status.split("VmHWM:")[1].split()[0]) * 1024 / 1e6


def main() -> None:
    sound: dict[str, list[Message]] = {}
    for task in json.loads(Path(sys.argv[1]).read_text(encoding="utf-8")):
        whole = task.get("sound")
        if whole:
            sound.setdefault(whole, read(Path(whole))[0])
            data = bytearray(Path(whole).read_bytes())
            KINDS[task["kind"]](data, random.Random(task["seed"]))
            Path(task["path"]).write_bytes(data)
        print(json.dumps(asdict(outcome(task, sound.get(whole, [])))), flush=True)


if __name__ == "__main__":
    main()
