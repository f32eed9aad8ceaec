"""Points that were not found at first are looked for again where those that were found say they should be.

A point beyond the reach of its search area is lost to a plain template search, though its neighbours give it away.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from stab_ros.core.geometry import apply, inside
from stab_ros.core.types import Correspondences, FloatArray, Homography, IdArray
from stab_ros.estimation import estimators

_THRESHOLD_PX = 1.0

Look = Callable[[Homography, IdArray], Correspondences]


def looked_for_twice(look: Look, guess: Homography, reference_px: FloatArray, size: tuple[int, int],
                     trust: FloatArray) -> Correspondences:
    """What `look` finds of all points from `guess`, and of the others in view from what these agree on.

    look: finds the points of the ids it is given near where a homography puts them. size: of the frame, (w, h).
    """
    found = look(guess, np.arange(len(reference_px)))
    better = estimators.refine(found, "affine", _THRESHOLD_PX, guess, trust[found.feature_id])
    if better is None or abs(np.linalg.det(better)) < 1e-9:
        return found
    missing = np.setdiff1d(np.arange(len(reference_px)), found.feature_id)
    in_view = inside(apply(np.linalg.inv(better), reference_px[missing]), size)
    return _merged(found, look(better, missing[in_view]))


def _merged(a: Correspondences, b: Correspondences) -> Correspondences:
    """Both, in the order of their ids."""
    order = np.argsort(np.concatenate([a.feature_id, b.feature_id]), kind="stable")
    both = Correspondences(np.concatenate([a.feature_id, b.feature_id]),
                           np.concatenate([a.reference_px, b.reference_px]),
                           np.concatenate([a.current_px, b.current_px]),
                           np.concatenate([a.information, b.information]))
    return both[order]
