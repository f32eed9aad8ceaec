"""A process that measures with OpenPIV (GPL-3); runs in OpenPIV's own environment. See peers_child.py.

Multi-pass with window deformation and the usual validation of each pass, pair by pair; then the median over the pairs.
settings: {"windows": sides of the passes, px, "gap": frames between the two of a pair}
"""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from importlib.metadata import version
from typing import Any

import numpy as np
from peers_child import serve

tools: Any = importlib.import_module("openpiv.tools")
pyprocess: Any = importlib.import_module("openpiv.pyprocess")
windef: Any = importlib.import_module("openpiv.windef")
PIVSettings: Any = importlib.import_module("openpiv.settings").PIVSettings


def measure(frames: Any, question: Mapping[str, Any]) -> Any:
    """(N, 5) as peers_child.py; vectors that the validation flags do not count in the median."""
    sides, gap = tuple(question["settings"]["windows"]), question["settings"]["gap"]
    of_passes = PIVSettings(windowsizes=sides, overlap=tuple(side // 2 for side in sides), num_iterations=len(sides))
    found = [_pair(frames[i], frames[i + gap], of_passes) for i in range(0, len(frames) - gap, gap)]
    u, v = _medians(np.array(found))
    x, y = pyprocess.get_rect_coordinates(frames[0].shape, sides[-1], sides[-1] // 2)
    scale = question["gsd_m"] * question["fps"] / gap
    rows = np.column_stack([x.ravel(), y.ravel(), u.ravel() * scale, v.ravel() * scale, np.zeros(x.size)])
    return rows[np.isfinite(rows).all(axis=1)]


def _pair(a: Any, b: Any, of_passes: Any) -> Any:
    """(2, rows, columns) px, y up; NaN where flagged. Rows go down the picture."""
    _, _, u, v, flags = windef.simple_multipass(a.astype(np.int32), b.astype(np.int32), of_passes)
    return np.where(np.asarray(flags, bool), np.nan, np.array([u, v]))


def _medians(pairs: Any) -> Any:
    """(2, rows, columns): over the pairs; NaN where none is left."""
    known = np.isfinite(pairs).any(axis=0)
    return np.where(known, np.nanmedian(np.where(known, pairs, 0.0), axis=0), np.nan)


if __name__ == "__main__":
    serve(f"OpenPIV {version('openpiv')}", tools.imread, measure)
