"""Text as programs of all systems write it: UTF-8, UTF-16 or an old code page, with a byte order mark or without."""

from __future__ import annotations

import codecs
from pathlib import Path

from stab_ros.core.errors import InputError

MOST_BYTES = 2**29  # that are read at once
_MARKS = ((codecs.BOM_UTF8, "utf-8-sig"), (codecs.BOM_UTF16_LE, "utf-16"), (codecs.BOM_UTF16_BE, "utf-16"))
_SAMPLE = 4096  # bytes that tell UTF-16 without a mark: Latin letters have a zero in every second place
_ZEROS = 0.4


def read_text(path: Path, what: str) -> str:
    """The text of a file; bytes that are none become replacement characters.

    what: the file must be, for messages.

    Raises:
        InputError: it is missing, cannot be read, or is larger than MOST_BYTES.
    """
    try:
        size = path.stat().st_size
        if size > MOST_BYTES:
            raise InputError(f"{path}: has {size} bytes, {what} must have at most {MOST_BYTES}")
        return decoded(path.read_bytes())
    except (OSError, ValueError) as error:  # ValueError: no possible name of a file
        reason = error.strerror if isinstance(error, OSError) else "is no name of a file"
        raise InputError(f"{path}: {reason}; it must be {what}") from error


def decoded(data: bytes) -> str:
    """The text of these bytes."""
    encoding = next((encoding for mark, encoding in _MARKS if data.startswith(mark)), None) or _guess(data)
    if encoding == "utf-8":
        try:
            return data.decode("utf-8")
        except UnicodeDecodeError:
            return data.decode("cp1252", errors="replace")
    return data.decode(encoding, errors="replace")


def _guess(data: bytes) -> str:
    even, odd = data[:_SAMPLE:2], data[1:_SAMPLE:2]
    if odd.count(0) > _ZEROS * len(odd) and even.count(0) < _ZEROS * len(even):
        return "utf-16-le"
    if even.count(0) > _ZEROS * len(even) and odd.count(0) < _ZEROS * len(odd):
        return "utf-16-be"
    return "utf-8"
