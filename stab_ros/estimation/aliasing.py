"""What sampling adds to the displacements of all features of a picture alike."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from stab_ros.core.types import Correspondences, Fit
from stab_ros.estimation.models import Basis

# Amplitude on rendered pictures 480 px wide and on larger ones with the same displacement all over.
_AMPLITUDE_PX = 0.005
_EVERY = 4  # a quarter of the features tells how much their displacements have in common


def with_aliasing(fit: Fit, pairs: Correspondences) -> Fit:
    """The fit with a covariance that includes interpolation and aliasing.

    They shift a feature towards or away from whole pixels, by a sine of its displacement. Where the displacements of
    the features differ by pixels, that averages out. Where they are the same, the fit follows it, and no residual
    shows it.
    """
    used = np.flatnonzero(fit.inlier)[::_EVERY]
    turns = np.exp(2j * np.pi * (pairs.current_px[used] - pairs.reference_px[used]))
    sigma_px = _AMPLITUDE_PX / np.sqrt(2) * np.abs(turns.mean(axis=0))  # along x and y
    shifts = Basis.around("translation", pairs.reference_px[used]).entry_jacobian(fit.ref_H_cur) * sigma_px
    return replace(fit, covariance=fit.covariance + shifts @ shifts.T)
