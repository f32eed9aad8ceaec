"""Text of numbers and errors."""

from __future__ import annotations


def number(value: float | None) -> str:
    """The number with full double precision; empty for None."""
    return "" if value is None else repr(float(value))


def one_line(text: object) -> str:
    """The text on one line; unprintable characters, such as terminal control codes, are replaced."""
    return "".join(c if c.isprintable() else "\N{REPLACEMENT CHARACTER}" for c in " ".join(str(text).split()))
