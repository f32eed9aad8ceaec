"""Text of numbers, counts and errors."""

from __future__ import annotations

from collections.abc import Iterable

_REASONS = 4  # warnings in one line


def number(value: float | None) -> str:
    """The number with full double precision; empty for None."""
    return "" if value is None else repr(float(value))


def counted(n: int, one: str, many: str = "") -> str:
    """The number and what there are so many of, as "1 frame" or "3 frames". many: "" for `one` with an s."""
    return f"{n} {one if n == 1 else many or one + 's'}"


def are(n: int) -> str:
    """The verb of so many: "is" or "are"."""
    return "is" if n == 1 else "are"


def one_line(text: object) -> str:
    """The text on one line; unprintable characters, such as terminal control codes, are replaced."""
    return "".join(c if c.isprintable() else "\N{REPLACEMENT CHARACTER}" for c in " ".join(str(text).split()))


def reasons(name: str, warnings: Iterable[str]) -> str:
    """What is warned of the input `name`, in brackets, to stand behind an error that it explains; "" for nothing."""
    told = [line.removeprefix(f"{name}: ") for line in warnings]
    more = f"; {len(told) - _REASONS} more" if len(told) > _REASONS else ""
    return f" ({'; '.join(told[:_REASONS])}{more})" if told else ""
