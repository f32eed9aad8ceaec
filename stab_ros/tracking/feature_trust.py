"""Memory of which features of the reference have proved to be static ground."""

from __future__ import annotations

import numpy as np

from stab_ros.core.types import BoolArray, Correspondences, Fit, FloatArray

_RATE = 0.2  # of a frame's evidence against a feature: half its trust is gone after three frames
_REGAINING = 0.05  # of a frame's evidence for it: what agrees by chance for a few frames is not ground yet


class FeatureTrust:
    """One trust in [0, 1] for each feature of the reference; all are trusted until they disagree.

    A feature that keeps moving against the fitted plane or is not found again (water, leaves, glitter) loses its say
    within a few frames, and gets it back within a second if it comes to rest. What lies outside the picture is left
    alone.
    """

    def __init__(self, features: int) -> None:
        self._trust = np.ones(features)
        self._frames = 2  # as if all had agreed in the two frames before the first

    @property
    def trust(self) -> FloatArray:
        """(features,) float64."""
        return self._trust

    def believe(self, trust: FloatArray) -> None:
        """What is known of them from elsewhere: (features,) in [0, 1], in place of what was learnt."""
        self._trust = trust.astype(np.float64)
        self._frames = max(self._frames, round(1 / _REGAINING))

    def learn(self, pairs: Correspondences, fit: Fit, in_view: BoolArray) -> None:
        """Move the trust of all features that should be visible towards whether they agreed with the accepted fit."""
        self._frames += 1
        agreed = np.zeros(len(self._trust))
        agreed[pairs.feature_id[fit.inlier]] = 1.0
        rate = np.maximum(np.where(agreed > self._trust, _REGAINING, _RATE), 1 / self._frames)
        self._trust[in_view] += (rate * (agreed - self._trust))[in_view]
