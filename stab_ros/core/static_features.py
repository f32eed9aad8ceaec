"""Memory of which features of the reference have proved to be static ground."""

from __future__ import annotations

import numpy as np

from stab_ros.core.types import Correspondences, Fit, FloatArray

_RATE = 0.2  # of a frame's evidence: half forgotten after three frames


class StaticFeatures:
    """One trust in [0, 1] for each feature of the reference; all are trusted until they disagree.

    A feature that keeps moving against the fitted plane (water, leaves) loses its say within a few frames, and gets it
    back as slowly if it comes to rest. What was not seen (occluded, outside the picture) is neither praised nor blamed.
    """

    def __init__(self, features: int) -> None:
        self._trust = np.ones(features)

    @property
    def trust(self) -> FloatArray:
        """(features,) float64."""
        return self._trust

    def learn(self, pairs: Correspondences, fit: Fit) -> None:
        """Move the trust of the features seen towards what each counted in the accepted fit."""
        seen = pairs.feature_id
        self._trust[seen] += _RATE * (fit.agreement - self._trust[seen])
