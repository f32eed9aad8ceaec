"""Direct alignment of a few hundred patches of the reference to the current frame; the default method.

Each patch keeps its integer place in the reference and reports, through its own template's gradient, how far the
current picture is off there, with the information that displacement carries (structure tensor over measured noise).
All patches together correct one homography, coarse to fine over an image pyramid and then again at full resolution
until nothing moves: joint inverse-compositional Gauss-Newton (Baker and Matthews 2004), but with the robust weights
on displacements in px, so that water that moves along with an intact texture is told from ground. Only the pyramid
touches every pixel of a frame.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import cv2
import numpy as np

from stab_ros.core import estimators
from stab_ros.core.config import Checked, setting
from stab_ros.core.geometry import apply, level_scale, rms_distance
from stab_ros.core.types import BoolArray, Correspondences, FloatArray, Gray, Homography
from stab_ros.methods import _patches
from stab_ros.methods._patches import Measured, Patches

_COARSEST_PX = 60  # no pyramid level has a side shorter than this
_COARSE_PATCHES = 150
_COARSE_STEPS = 3
_COARSE_THRESHOLD_PX = 1.0  # of the level
_FINE_STEPS = 4
_FINE_THRESHOLD_PX = 0.5
_CONVERGED_PX = 0.003
_LINEAR_PX = 2.0  # beyond, a displacement is no measurement any more


@dataclass(frozen=True)
class Level:
    """One level of the pyramid: its patches, and for each the full-resolution patches that lie in it."""

    patches: Patches
    scale: Homography
    covers: FloatArray  # (N, features), rows that average the trust of what a patch covers


class Direct:
    """`stab_ros.methods.Method` by direct alignment."""

    @dataclass(frozen=True)
    class Config(Checked):
        patches: int = setting(600, "number of patches, spread evenly", 16, 5000)
        radius: int = setting(8, "half the side of a patch, px: 8 is 17x17", 3, 20)
        min_correlation: float = setting(0.5, "a patch that looks less like its template is left out", 0.1, 0.99)
        min_texture: float = setting(0.5, "least mean squared gradient of a patch, grey levels^2 per px^2", 0.01, 1e4)
        subset: str = setting("all", "use every patch or every other one: two disjoint halves check each other",
                              choices=("all", "even", "odd"))

    def __init__(self, reference: Gray, allowed: BoolArray, config: Direct.Config) -> None:
        """reference: (h, w) uint8. allowed: (h, w) bool, where patches may lie."""
        self._config = config
        pyramid = build_pyramid(reference)
        centres = _patches.choose(reference, allowed, config.patches, config.radius, config.min_texture)
        if config.subset != "all":
            centres = centres[config.subset == "odd" :: 2]
        self.reference_px: FloatArray = centres.astype(np.float64)
        self._fine = _patches.cut(reference, centres, config.radius)
        self._coarse = [self._level(pyramid[k], allowed, k) for k in range(len(pyramid) - 1, 0, -1)]

    def _level(self, gray: Gray, allowed: BoolArray, level: int) -> Level:
        radius = self._config.radius
        small = cv2.resize(allowed.astype(np.uint8), gray.shape[::-1], interpolation=cv2.INTER_NEAREST).astype(bool)
        centres = _patches.choose(gray, small, _COARSE_PATCHES, radius, self._config.min_texture)
        scale = level_scale(level)
        apart = np.abs(apply(scale, self.reference_px)[None] - centres[:, None]).max(axis=2, initial=0)
        covers = (apart <= radius).astype(np.float64)
        return Level(_patches.cut(gray, centres, radius), scale, covers)

    @property
    def features(self) -> int:
        return len(self._fine)

    def match(self, current: Gray, guess: Homography, trust: FloatArray) -> Correspondences:
        H = guess
        pyramid = build_pyramid(current)
        for gray, level in zip(reversed(pyramid[1:]), self._coarse, strict=True):
            H = self._align_level(gray, level, H, trust)
        return self._align_fine(current, H, trust)

    def _align_level(self, gray: Gray, level: Level, guess: Homography, trust: FloatArray) -> Homography:
        """`guess` corrected by one pyramid level; unchanged where the level has too little to say."""
        to_level, from_level = level.scale, np.linalg.inv(level.scale)
        H = to_level @ guess @ from_level
        H = H / H[2, 2]
        known = level.covers.sum(axis=1)
        level_trust = np.where(known > 0, level.covers @ trust / np.maximum(known, 1), 1.0)
        for _ in range(_COARSE_STEPS):
            pairs = self._pairs(level.patches, _patches.measure(level.patches, gray, np.linalg.inv(H), False), H)
            better = estimators.refine(pairs, "affine", _COARSE_THRESHOLD_PX, H, level_trust[pairs.feature_id])
            if better is None:
                return guess
            moved, H = rms_distance(better, H, gray.shape[::-1]), better
            if moved < 0.05:
                break
        H = from_level @ H @ to_level
        return np.asarray(H / H[2, 2])

    def _align_fine(self, gray: Gray, H: Homography, trust: FloatArray) -> Correspondences:
        """Measure and correct at full resolution until the correction is negligible; the last measurement counts."""
        size = gray.shape[::-1]
        for step in range(_FINE_STEPS):
            pairs = self._pairs(self._fine, _patches.measure(self._fine, gray, np.linalg.inv(H), step > 0), H)
            better = estimators.refine(pairs, "projective", _FINE_THRESHOLD_PX, H, trust[pairs.feature_id])
            if better is None:
                break
            moved, H = rms_distance(better, H, size), better
            if step > 0 and moved < _CONVERGED_PX:
                break
        return pairs

    def _pairs(self, patches: Patches, measured: Measured, H: Homography) -> Correspondences:
        """Those patches that were found again, as correspondences."""
        near = np.abs(measured.displacement).max(axis=1, initial=0) <= _LINEAR_PX
        found = np.flatnonzero(near & (measured.correlation >= self._config.min_correlation))
        reference_px = patches.centres[found].astype(np.float64)
        current_px = apply(np.linalg.inv(H), reference_px + measured.displacement[found])
        return Correspondences(found, reference_px, current_px, measured.information[found])


def build_pyramid(gray: Gray) -> list[Gray]:
    """The picture, then its 2x2 averages down to `_COARSEST_PX`; an odd last row or column is left out."""
    pyramid = [gray]
    while min(pyramid[-1].shape) >= 2 * _COARSEST_PX:
        height, width = (n // 2 for n in pyramid[-1].shape)
        even = pyramid[-1][: 2 * height, : 2 * width]
        pyramid.append(np.asarray(cv2.resize(even, (width, height), interpolation=cv2.INTER_AREA)))
    return pyramid
