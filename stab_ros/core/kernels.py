"""How the inner loops are compiled."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numba


def kernel(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """`numba.njit`, without the GIL, and cached on disk where there is a folder that can be written."""

    def compiled(function: Callable[..., Any]) -> Any:
        try:
            return numba.njit(cache=True, nogil=True, **options)(function)
        except RuntimeError:  # a service user without a home, a read-only container: compiled anew in each process
            return numba.njit(nogil=True, **options)(function)

    return compiled
