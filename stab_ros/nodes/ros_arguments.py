"""The ROS arguments of a command line, as rcl finds them: between `--ros-args` and `--`."""

from __future__ import annotations

from collections.abc import Iterator, Sequence


def values_of(words: Sequence[str], *flags: str) -> Iterator[str]:
    """The words that follow one of these flags, in their order. words: of the command line."""
    of_ros, before = False, ""
    for word in words:
        if of_ros and before in flags:
            yield word
        of_ros = word == "--ros-args" or (of_ros and word != "--")
        before = word
