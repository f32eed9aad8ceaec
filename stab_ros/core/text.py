"""How numbers and errors are written."""

from __future__ import annotations


def number(value: float | None) -> str:
    """Full double precision; empty where there is none."""
    return "" if value is None else repr(float(value))


def one_line(text: object) -> str:
    """Without line breaks, as an error is one line, and without what a terminal would obey."""
    return "".join(c if c.isprintable() else "\N{REPLACEMENT CHARACTER}" for c in " ".join(str(text).split()))
