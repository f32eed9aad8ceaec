"""Prints CHANGELOG.rst, as bloom and catkin's tools read it (REP 132), from CHANGELOG.md, where changes are written.

python docs/make_changelog.py > CHANGELOG.rst
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

from stab_ros.core.errors import InputError

SOURCE = Path(__file__).parents[1] / "CHANGELOG.md"
_TITLE = "Changelog for package stab_ros"
_VERSION = re.compile(r"## \[(?P<version>[^]]+)\](?: - (?P<date>\d{4}-\d{2}-\d{2}))?$")


def rst(markdown: str) -> str:
    """The changelog in reStructuredText.

    Raises:
        InputError: a line is none of version, kind of change, item and continuation of an item.
    """
    body = markdown[markdown.index("\n## ") + 1 :]
    bar = "^" * len(_TITLE)
    return "\n".join([bar, _TITLE, bar, *(line for source in body.splitlines() for line in _lines(source))]) + "\n"


def _lines(source: str) -> Iterator[str]:
    """What becomes of a line: items are nested below their kind of change, Added, Changed, ..."""
    if not source:
        return
    if version := _VERSION.match(source):
        heading = "Forthcoming" if version["version"] == "Unreleased" else f"{version['version']} ({version['date']})"
        yield from ("", heading, "-" * len(heading))
    elif source.startswith("### "):
        yield from ("", f"* {source.removeprefix('### ')}", "")
    elif source.startswith(("- ", "  ")):
        yield f"  {'*' if source.startswith('-') else ' '}{_inline(source[1:])}"
    else:
        raise InputError(f"CHANGELOG.md: {source!r} cannot be told in CHANGELOG.rst, it must be an item that begins "
                         "with '- ' or '  ', a kind of change '### ...', or a version '## [1.2.3] - 2026-01-31'")


def _inline(text: str) -> str:
    """Code in double backticks; of a link its text, as its target may be a file of this repository."""
    plain = re.sub(r"\[([^]]+)\]\([^)]+\)", r"\1", text)
    return re.sub(r"`([^`]+)`", r"``\1``", plain)


if __name__ == "__main__":
    print(rst(SOURCE.read_text(encoding="utf-8")), end="")
