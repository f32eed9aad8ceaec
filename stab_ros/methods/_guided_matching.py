"""Guided matching (Hartley and Zisserman 2004, section 4.8): a second search around a motion fitted to the first one.

A point outside its search area is lost to a plain template search, although the motion of its neighbours predicts it.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from stab_ros.core.geometry import apply, inside
from stab_ros.core.types import Correspondences, FloatArray, Homography, IdArray
from stab_ros.estimation import estimators

_THRESHOLD_PX = 1.0

Search = Callable[[Homography, IdArray], Correspondences]


def guided_matches(search: Search, guess: Homography, reference_px: FloatArray, size: tuple[int, int],
                     trust: FloatArray) -> Correspondences:
    """Correspondences of two searches: all points from `guess`, then the missing ones from a fit to the found ones.

    Args:
        search: finds the points with the given ids near their positions under a homography `ref_H_cur`.
        guess: predicted `ref_H_cur`.
        reference_px: (N, 2) points of the reference, px.
        size: width and height of the frame, px.
        trust: (N,) prior weights in [0, 1].
    """
    found = search(guess, np.arange(len(reference_px)))
    better = estimators.refine(found, "affine", _THRESHOLD_PX, guess, trust[found.feature_id])
    if better is None or abs(np.linalg.det(better)) < 1e-9:
        return found
    missing = np.setdiff1d(np.arange(len(reference_px)), found.feature_id)
    in_view = inside(apply(np.linalg.inv(better), reference_px[missing]), size)
    return _merged(found, search(better, missing[in_view]))


def _merged(a: Correspondences, b: Correspondences) -> Correspondences:
    """Both sets, ordered by feature id."""
    order = np.argsort(np.concatenate([a.feature_id, b.feature_id]), kind="stable")
    both = Correspondences(np.concatenate([a.feature_id, b.feature_id]),
                           np.concatenate([a.reference_px, b.reference_px]),
                           np.concatenate([a.current_px, b.current_px]),
                           np.concatenate([a.information, b.information]))
    return both[order]
