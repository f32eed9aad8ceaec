"""By what measured velocities are known again."""

from __future__ import annotations

from hashlib import sha256

import numpy as np

from stab_ros.velocimetry.vectors import Vectors

_DECIMALS = 4  # of places: a recording and its table differ in the last bits
_LETTERS = 16


def digest(vectors: Vectors) -> str:
    """16 hexadecimal digits that tell velocities from all others: of places, to 0.1 mm, and stamps, in any order."""
    stamps = np.column_stack([vectors.start_ns, vectors.end_ns]).astype("<i8")
    places = np.round(np.column_stack([vectors.start_m, vectors.end_m]), _DECIMALS).astype("<f8") + 0.0  # no -0.0
    order = np.lexsort([*places.T, *stamps.T])
    return sha256(stamps[order].tobytes() + places[order].tobytes()).hexdigest()[:_LETTERS]
