"""Bytes objects that are filled after their creation, so that an image is written into its message without a copy."""

from __future__ import annotations

import ctypes

import numpy as np
from numpy.typing import NDArray

# As the C API defines it: bytes that are created from NULL must be filled before other code sees them.
_make = ctypes.pythonapi.PyBytes_FromStringAndSize
_make.restype, _make.argtypes = ctypes.py_object, (ctypes.c_char_p, ctypes.c_ssize_t)
_address_of = ctypes.pythonapi.PyBytes_AsString
_address_of.restype, _address_of.argtypes = ctypes.c_void_p, (ctypes.py_object,)


def new_bytes(size: int) -> tuple[bytes, NDArray[np.uint8]]:
    """`size` bytes, and the same memory as (size,) uint8, valid as long as the bytes are kept; not initialised."""
    made: bytes = _make(None, size)
    return made, np.ctypeslib.as_array((ctypes.c_uint8 * size).from_address(_address_of(made)))
