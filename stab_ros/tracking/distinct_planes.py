"""Which planes are one: frames that show neither well can part the features of one plane in two groups."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from stab_ros.core.types import FloatArray
from stab_ros.tracking.planes import Plane

_SAME_PX = 0.1  # planes that never separate by more are one
_SHOWN_TOGETHER = 0.5  # in at least so many of the frames: with fewer it is not known


def distinct(planes: list[Plane], reference_px: FloatArray) -> list[Plane]:
    """The planes, the largest first; one that moves as a larger one does is part of it.

    reference_px: (N, 2), of all features.
    """
    kept: list[Plane] = []
    for plane in sorted(planes, key=len, reverse=True):
        same = next((k for k, other in enumerate(kept) if _are_one(plane, other, reference_px)), None)
        if same is None:
            kept.append(plane)
        else:
            kept[same] = replace(kept[same], member=kept[same].member | plane.member)
    return kept


def _are_one(plane: Plane, other: Plane, reference_px: FloatArray) -> bool:
    """Whether two planes never separate, where the features of the smaller one, `plane`, lie."""
    together = float(np.mean(plane.known & other.known))
    if plane.at_rest or other.at_rest or together < _SHOWN_TOGETHER:
        return False
    return plane.apart_px(other, plane.current_px(reference_px[plane.member])) < _SAME_PX
