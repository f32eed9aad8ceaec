"""Reads the lines of `stiv`: JSON text, or a .json file."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from stab_ros.core.errors import InputError
from stab_ros.core.settings import Value
from stab_ros.core.types import FloatArray

_MOST = 1000
_MAX_TEXT = 2**20  # characters


def read_lines(values: Mapping[str, Value]) -> tuple[FloatArray, ...]:
    """Reads the parameter `lines`.

    Args:
        values: parameters by name; `lines` is JSON `[[[x, y], [x, y]], ...]`, or with the x and y of lines in turn,
            `[x, y, x, y, ...]`, or the path of such a file.

    Returns:
        The two ends, (2, 2), of each line.

    Raises:
        InputError: a file is missing, or the JSON holds no such lines.
    """
    text = str(values.get("lines", "")).strip()
    if not text:
        return ()
    where = "the value" if text.startswith("[") else repr(text[:80])
    try:
        if not text.startswith("["):
            text = Path(text).read_text(encoding="utf-8-sig")[:_MAX_TEXT]
        lines = _ends(np.array(json.loads(text), float))
    except OSError as error:
        raise InputError(f"lines: {where} cannot be read ({error.strerror}), it must be a .json of lines") from error
    except (ValueError, TypeError, OverflowError, RecursionError) as error:
        raise InputError(f"lines: {where} must be JSON [[[x, y], [x, y]], ...]") from error
    if lines.ndim != 3 or lines.shape[1:] != (2, 2) or not 0 < len(lines) <= _MOST or not np.isfinite(lines).all():
        raise InputError(f"lines: {where} must be JSON [[[x, y], [x, y]], ...], 1 to {_MOST} lines of numbers")
    if not (np.ptp(lines, axis=1).max(axis=1) > 0).all():
        raise InputError(f"lines: {where} holds a line whose ends are the same point")
    return tuple(lines)


def _ends(listed: FloatArray) -> FloatArray:
    """(n, 2, 2) ends of n lines, of which a list holds the x and y in turn; another list as it is."""
    in_turn = listed.ndim == 1 or listed.shape == (2, 2)
    return listed.reshape(-1, 2, 2) if in_turn and listed.size % 4 == 0 else listed
