"""A weight for each feature: how well it has agreed with static ground so far."""

from __future__ import annotations

import numpy as np

from stab_ros.core.types import BoolArray, Correspondences, Fit, FloatArray

_RATE = 0.2  # of a frame's evidence against a feature: half its weight is gone after three frames
_REGAINING = 0.05  # of a frame's evidence for it: what agrees by chance for a few frames is not ground yet


class FeatureTrust:
    """One weight in [0, 1] for each feature of an anchor, 1 at first.

    A feature that keeps moving against the fitted plane or is not found again (water, leaves, glitter) is down-weighted
    within a few frames, and regains its weight within a second if it comes to rest. Features outside the image keep
    theirs.
    """

    def __init__(self, features: int) -> None:
        self._trust = np.ones(features)
        self._frames = 2  # as if all had agreed in the two frames before the first
        self._blocked: BoolArray = np.zeros(features, bool)

    @property
    def trust(self) -> FloatArray:
        """(features,) float64."""
        return self._trust

    def set_prior(self, trust: FloatArray) -> None:
        """Replaces the weights by a prior, (features,) in [0, 1]."""
        self._trust = np.where(self._blocked, 0.0, trust)
        self._frames = max(self._frames, round(1 / _REGAINING))

    def block(self, which: BoolArray) -> None:
        """The features `which`, (features,) bool, are no part of the scene: they have no weight from now on."""
        self._blocked = self._blocked | which
        self._trust = np.where(self._blocked, 0.0, self._trust)

    def update(self, pairs: Correspondences, fit: Fit, in_view: BoolArray) -> None:
        """Moves the weights of features in view, (features,) bool, towards 1 for inliers of the fit, else 0."""
        self._frames += 1
        agreed = np.zeros(len(self._trust))
        agreed[pairs.feature_id[fit.inlier]] = 1.0
        rate = np.maximum(np.where(agreed > self._trust, _REGAINING, _RATE), 1 / self._frames)
        moved = in_view & ~self._blocked
        self._trust[moved] += (rate * (agreed - self._trust))[moved]
