"""An image as it came over DDS, and the frame in it: decoded when it is first asked for, once for all who ask."""

from __future__ import annotations

from collections.abc import Mapping
from threading import Lock

from stab_ros.core.types import Frame
from stab_ros.io.image_message import read_image


class ReceivedImage:
    """number: that of its publisher. source_ns: when it was published. Safe to share between threads."""

    def __init__(self, cdr: bytes, msgtype: str, info: Mapping[str, int]) -> None:
        self.number, self.source_ns = info["publication_sequence_number"], info["source_timestamp"]
        self._cdr, self._msgtype = cdr, msgtype
        self._frame: Frame | None = None
        self._lock = Lock()

    def frame(self) -> Frame:
        """The frame, which nobody may write to.

        Raises:
            MessageError: the message is damaged.
        """
        with self._lock:
            if self._frame is None:
                self._frame = read_image(self._cdr, self._msgtype)
            return self._frame
