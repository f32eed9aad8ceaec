"""Tuning of malloc for large images (glibc only; no effect elsewhere)."""

from __future__ import annotations

import ctypes
import os

_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD = -1, -3  # malloc.h


def keep_freed_memory() -> None:
    """Makes malloc reuse the memory of previous images, which saves a third of the CPU time for large frames."""
    if any(name.startswith("MALLOC_") for name in os.environ):
        return  # configured by the user
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is not None:
        mallopt(_M_MMAP_THRESHOLD, 1 << 26)
        mallopt(_M_TRIM_THRESHOLD, 1 << 27)


def give_back_memory() -> None:
    """Returns free memory to the system, after work that needs more memory than what follows."""
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    if trim is not None:
        trim(0)
