"""Groups of vectors as one."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from stab_ros.velocimetry.vectors import Vectors


def joined(vectors: Sequence[Vectors]) -> Vectors:
    """All vectors of one or more groups of one unit, with the same shared errors."""
    arrays = [np.concatenate([getattr(one, name) for one in vectors]) for name in
              ("start_m", "end_m", "start_ns", "end_ns", "covariance", "shared", "track_id")]
    return Vectors(arrays[0], arrays[1], arrays[2], arrays[3], arrays[4], arrays[5], arrays[6], vectors[0].unit)
