"""Publishing without Python's interpreter lock, which rclpy keeps until the middleware has sent a message.

Over UDP that lasts as long as the link takes to send what finds no room in the socket's buffer: 0.3 s for 0.7 MB at 20
Mbit/s, during which no other thread of a node runs. Whoever asks what has been acknowledged waits as long, while
something is sent again.
"""

from __future__ import annotations

import ctypes
from functools import cache

from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
from rclpy.publisher import Publisher

_LIBRARY = "librcl.so"  # which rclpy has loaded
_TIMEOUT = 2  # RCL_RET_TIMEOUT


class _SerializedMessage(ctypes.Structure):
    """rcl_serialized_message_t (rcutils/types/uint8_array.h); its allocator is not used for publishing."""

    _fields_ = (("buffer", ctypes.c_char_p), ("length", ctypes.c_size_t), ("capacity", ctypes.c_size_t),
                ("allocator", ctypes.c_void_p * 5))


def publish_unlocked(publisher: Publisher, data: bytes) -> None:
    """As `publisher.publish(data)`, while other threads go on; for a thread of its own.

    Raises:
        RCLError: it could not be published.
    """
    message = _SerializedMessage(data, len(data), len(data))
    with publisher.handle:
        code = _publish()(publisher.handle.pointer, ctypes.byref(message), None)
    if code:
        raise _rclpy.RCLError(f"Failed to publish: {code}")


def acknowledged_unlocked(publisher: Publisher, timeout_ns: int) -> bool:
    """As `publisher.wait_for_all_acked`, while other threads go on; for a thread of its own.

    Raises:
        RCLError: the middleware cannot tell.
    """
    with publisher.handle:
        code = _wait()(publisher.handle.pointer, timeout_ns)
    if code not in (0, _TIMEOUT):
        raise _rclpy.RCLError(f"Failed to wait for acknowledgements: {code}")
    return bool(code == 0)


@cache
def _publish() -> ctypes._NamedFuncPointer:
    function = ctypes.CDLL(_LIBRARY).rcl_publish_serialized_message
    function.argtypes = (ctypes.c_void_p, ctypes.c_void_p, ctypes.c_void_p)
    return function


@cache
def _wait() -> ctypes._NamedFuncPointer:
    function = ctypes.CDLL(_LIBRARY).rcl_publisher_wait_for_all_acked
    function.argtypes = (ctypes.c_void_p, ctypes.c_int64)
    return function
