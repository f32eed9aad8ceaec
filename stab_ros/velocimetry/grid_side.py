"""A side of cells that suits what vectors cover."""

from __future__ import annotations

import math

import numpy as np

from stab_ros.velocimetry.vectors import Vectors

_CELLS = 30  # along the longer side
_ROUND = (1.0, 2.0, 5.0, 10.0)


def side_for(vectors: Vectors) -> float:
    """A round side, 1, 2 or 5 times a power of ten; 1 where the vectors cover nothing."""
    extent = float(np.ptp(vectors.position_m, axis=0).max()) if len(vectors) else 0.0
    if not extent > 0:
        return 1.0
    wanted = extent / _CELLS
    decade = 10.0 ** math.floor(math.log10(wanted))
    return decade * min(_ROUND, key=lambda factor: abs(math.log(factor * decade / wanted)))
