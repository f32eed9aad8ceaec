"""ROS messages as other nodes send them, and ways to damage them."""

from __future__ import annotations

from array import array
from collections.abc import Callable

import numpy as np
from hypothesis import strategies as st
from sensor_msgs.msg import Image

from stab_ros.core.errors import MessageError
from stab_ros.io.cdr import Header

HEADER = Header(1_700_000_000_123_456_789, "camera")


def ros_image(pixels: np.ndarray, encoding: str, padding: int = 0, big_endian: bool = False) -> Image:
    """An Image as a driver would fill it."""
    height, width = pixels.shape[:2]
    stored = pixels.astype(pixels.dtype.newbyteorder(">" if big_endian else "<"))
    rows = [row.tobytes() + bytes([0xAB]) * padding for row in stored]
    message = Image(height=height, width=width, encoding=encoding, is_bigendian=int(big_endian), step=len(rows[0]))
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(HEADER.stamp_ns, 10**9)
    message.header.frame_id = HEADER.frame_id
    message.data = array("B", b"".join(rows))
    return message


def random_pixels(encoding: str, rng: np.random.Generator) -> np.ndarray:
    """7 rows of 9 pixels."""
    if encoding == "32FC1":
        return np.asarray(rng.normal(290, 5, (7, 9)), np.float32)
    dtype = np.uint16 if "16" in encoding else np.uint8
    channels = {"b": 3, "r": 3, "8UC3": 3}.get(encoding if encoding == "8UC3" else encoding[0], 1)
    channels = 4 if encoding in ("bgra8", "rgba8", "8UC4") else channels
    shape = (7, 9) if channels == 1 else (7, 9, channels)
    return rng.integers(0, np.iinfo(dtype).max, shape, dtype, endpoint=True)


@st.composite
def damaged(draw: st.DrawFn, sound: bytes) -> bytes:
    """`sound` with up to four bytes changed, and perhaps cut short."""
    cdr = bytearray(sound)
    for _ in range(draw(st.integers(1, 4))):
        cdr[draw(st.integers(0, min(len(cdr), 400) - 1))] = draw(st.integers(0, 255))
    return bytes(cdr[: draw(st.one_of(st.just(len(cdr)), st.integers(0, len(cdr))))])


def complaint(read: Callable[[bytes], object], cdr: bytes) -> str:
    """The text of the MessageError, "" without one; any other error fails the test."""
    try:
        read(cdr)
    except MessageError as error:
        return str(error)
    return ""
