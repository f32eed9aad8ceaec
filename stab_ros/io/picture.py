"""The images of an input as a stream, each decoded or with the reason why it cannot be."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from enum import Enum

from stab_ros.core.errors import InputError, MessageError
from stab_ros.core.text import reasons
from stab_ros.core.types import Frame
from stab_ros.io.bag import Message
from stab_ros.io.frame_reader import Decoded


class Clock(Enum):
    """What images are stamped with: their header stamps, or the times at which they were logged."""

    HEADER = "header"
    LOG = "log"


@dataclass(frozen=True, eq=False)
class Picture:
    """One image of a recorded stream.

    Attributes:
        log_time_ns: when the message was recorded, ns.
        publish_time_ns: when it was published, ns.
        stamp_ns: the header stamp, ns.
        decoded: the frame, or the MessageError that says why it cannot be decoded.
        data: the recorded message in CDR; None for videos and folders.
    """

    log_time_ns: int
    publish_time_ns: int
    stamp_ns: int
    decoded: Decoded
    data: bytes | None = None

    def stamped_as_logged(self, restamped: Callable[[bytes, int], bytes]) -> Picture:
        """Takes the log time for the header stamp.

        Args:
            restamped: gives a message another stamp, ns; raises a MessageError where that cannot be.

        Returns:
            The same image with the new stamp, in its message too.
        """
        log_ns = self.log_time_ns
        if isinstance(self.decoded, MessageError):
            return replace(self, stamp_ns=log_ns)
        try:
            data = self.data and restamped(self.data, log_ns)
        except MessageError as error:  # the log time fits no stamp
            return replace(self, stamp_ns=log_ns, decoded=error)
        return replace(self, stamp_ns=log_ns, decoded=replace(self.decoded, stamp_ns=log_ns), data=data)


def limited(items: Iterable[Picture | Message], limit: int | None) -> Iterator[Picture | Message]:
    """The items up to and without image number `limit`, counted from 0 (None: all)."""
    pictures = 0
    for item in items:
        if isinstance(item, Picture):
            if pictures == limit:
                return
            pictures += 1
        yield item


def readable(name: str, topic: str, items: Iterable[Picture | Message],
             warnings: Callable[[], Iterable[str]] = list) -> Iterator[Picture | Message]:
    """The items of input `name`.

    warnings: gives what its reader warns of, once it has read all.

    Raises:
        InputError: at the end, if no image of `topic` could be decoded.
    """
    problem, found = "it is empty", False
    for item in items:
        if isinstance(item, Picture):
            found = found or isinstance(item.decoded, Frame)
            problem = problem if isinstance(item.decoded, Frame) else str(item.decoded)
        yield item
    if not found:
        raise InputError(f"{name}: not one image of {topic} can be decoded ({problem}); it must hold at least one"
                         f"{reasons(name, warnings())}")


def only_pictures(items: Iterable[Picture | Message]) -> Iterator[Picture]:
    """The images without the other messages."""
    return (item for item in items if isinstance(item, Picture))
