"""Direct alignment of a few hundred patches of the reference to the current frame; the default method.

Each patch keeps its integer place in the reference and reports, through its own template's gradient, how far the
current picture is off there, with the information that displacement carries (structure tensor over measured noise).
All patches together correct one homography, coarse to fine over an image pyramid and then again at full resolution
until nothing moves: joint inverse-compositional Gauss-Newton (Baker and Matthews 2004), but with the robust weights
on displacements in px, so that water that moves along with an intact texture is told from ground. Only the pyramid
touches every pixel of a frame.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, ClassVar

import cv2
import numpy as np

from stab_ros.core.geometry import apply, level_scale, normalized, rms_distance
from stab_ros.core.settings import Checked, setting
from stab_ros.core.types import NO_POINTS, BoolArray, Correspondences, FloatArray, Gray, Homography, IdArray
from stab_ros.estimation import estimators
from stab_ros.estimation.models import MODELS, minimal_points
from stab_ros.methods import spread
from stab_ros.methods.patches import Patches, cut_patches, measure_patches

_COARSEST_PX = 60  # no pyramid level has a side shorter than this
_COARSE_PATCHES = 150  # of each coarser level
_ALIGNING_PATCHES = 400  # at full resolution; all patches measure only once, when the alignment stands
_TRUSTED = 0.3
_MOST = 0.6  # of the patches
_SCATTERED_PX = 0.65  # a typical distance is 0.1 to 0.4, with 9 px of motion blur 0.5, and 0.8 where errors reach 1 px
_LINEAR_PX = 2.0  # beyond, a displacement is no measurement any more


@dataclass(frozen=True)
class Steps:
    """How an alignment goes about it: at most so many steps, each robust to what is off by more than the threshold."""

    most: int
    model: str
    threshold_px: float
    converged_px: float


_COARSE = Steps(3, "affine", 1.0, 0.2)
_FINE = Steps(4, "projective", 0.5, 0.01)


def _finely(patches: int) -> Steps:
    """At full resolution, in the largest model that so many patches determine."""
    models = [model for model in MODELS if minimal_points(model) <= patches]
    return replace(_FINE, model=models[-1]) if models else _FINE


@dataclass(frozen=True, eq=False)
class Level:
    """One coarser level of the pyramid.

    covers: (pairs, 2) a patch of its own, and a full-resolution patch whose centre lies in it.
    """

    patches: Patches
    scale: Homography
    covers: IdArray

    def trust(self, fine: FloatArray) -> FloatArray:
        """(N,) mean trust of what each patch covers, 0 where most is not trusted; 1 where it covers nothing."""
        own, covered = self.covers.T
        count = np.bincount(own, minlength=len(self.patches))
        total = np.bincount(own, fine[covered], minlength=len(self.patches))
        mean = np.where(count > 0, total / np.maximum(count, 1), 1.0)
        return np.where(mean > _TRUSTED, mean, 0.0)


@dataclass(frozen=True)
class DirectConfig(Checked):
    """Parameters `direct.*`."""

    patches: int = setting(2400, "number of patches, spread evenly", 16, 20000)
    radius: int = setting(8, "half the side of a patch, px: 8 is 17x17", 3, 20)
    min_correlation: float = setting(0.5, "a patch that looks less like its template is left out", 0.1, 0.99)
    min_texture: float = setting(0.5, "least mean squared gradient of a patch, grey levels^2 per px^2", 0.01, 1e4)
    subset: str = setting("all", "use every patch or every other one: two disjoint halves check each other",
                          choices=("all", "even", "odd"))


class Direct:
    """`stab_ros.methods.Method` by direct alignment."""

    Config: ClassVar[type[Any]] = DirectConfig
    takes_points: ClassVar[bool] = True
    seeks_all: ClassVar[bool] = True

    def __init__(self, reference: Gray, allowed: BoolArray, config: DirectConfig,
                 points_px: FloatArray = NO_POINTS) -> None:
        """reference: (h, w) uint8. allowed: (h, w) bool, where patches may lie. points_px: (n, 2), or none.

        Given points are the centres of the patches that measure, to the whole px; those of the coarser levels, which
        only find the way, lie where they are allowed.
        """
        self._config = config
        pyramid = build_pyramid(reference)
        if len(points_px):
            centres = spread.within(np.round(points_px).astype(np.int64), reference.shape, config.radius)
        else:
            centres = spread.choose(reference, allowed, config.patches, config.radius, config.min_texture)
        if config.subset != "all":
            centres = centres[config.subset == "odd" :: 2]
        self._fine = cut_patches(reference, centres, config.radius)
        self.reference_px: FloatArray = self._fine.centres.astype(np.float64)
        self._coarse = [self._level(pyramid[k], allowed, k) for k in range(len(pyramid) - 1, 0, -1)]

    def _level(self, gray: Gray, allowed: BoolArray, level: int) -> Level:
        radius = self._config.radius
        small = cv2.resize(allowed.astype(np.uint8), gray.shape[::-1], interpolation=cv2.INTER_NEAREST).astype(bool)
        centres = spread.choose(gray, small, _COARSE_PATCHES, radius, self._config.min_texture)
        scale = level_scale(level)
        patches = cut_patches(gray, centres, radius)
        apart = np.abs(apply(scale, self.reference_px)[None] - patches.centres[:, None]).max(axis=2, initial=0)
        return Level(patches, scale, np.argwhere(apart <= radius))

    def match(self, current: Gray, guess: Homography, trust: FloatArray) -> Correspondences:
        """Coarser pictures only where few patches are found by the guess.

        Else they could only lead astray, with water beside the ground in every patch.
        """
        chosen = self._aligning(trust)
        H, seen = guess, self._look(self._fine, chosen, current, guess)
        if len(seen) <= _MOST * len(chosen):
            H = self._align_coarse(current, guess, trust)
            seen = self._look(self._fine, chosen, current, H)
        better = self._align(self._fine, seen, chosen, current, H, trust, _finely(len(chosen)))
        H = H if better is None else better
        pairs = self._look(self._fine, np.arange(len(self._fine)), current, H)
        return pairs if _agrees(pairs, H, trust) else pairs[:0]

    def _align_coarse(self, gray: Gray, guess: Homography, trust: FloatArray) -> Homography:
        """`guess` corrected over the pyramid, from its top to the level below full resolution."""
        H = guess
        for small, level in zip(reversed(build_pyramid(gray)[1:]), self._coarse, strict=True):
            H = self._align_level(small, level, H, trust)
        return H

    def _align_level(self, gray: Gray, level: Level, guess: Homography, trust: FloatArray) -> Homography:
        """`guess` corrected by one pyramid level; unchanged where the level has too little to say."""
        H = normalized(level.scale @ guess @ np.linalg.inv(level.scale))
        every = np.arange(len(level.patches))
        seen = self._look(level.patches, every, gray, H)
        better = self._align(level.patches, seen, every, gray, H, level.trust(trust), _COARSE)
        return guess if better is None else normalized(np.linalg.inv(level.scale) @ better @ level.scale)

    @staticmethod
    def _aligning(trust: FloatArray) -> IdArray:
        """An even share of the patches that are trusted."""
        trusted = np.flatnonzero(trust > _TRUSTED)
        return trusted[:: max(1, len(trusted) // _ALIGNING_PATCHES)]

    def _align(self, patches: Patches, seen: Correspondences, chosen: IdArray, gray: Gray, H: Homography,
               trust: FloatArray, steps: Steps) -> Homography | None:
        """Correct and measure until the correction is negligible, from what is seen by H; None where that fails."""
        for step in range(steps.most):
            pairs = self._look(patches, chosen, gray, H) if step else seen
            better = estimators.refine(pairs, steps.model, steps.threshold_px, H, trust[pairs.feature_id])
            if better is None:
                return None
            moved, H = rms_distance(better, H, gray.shape[::-1]), better
            if moved < steps.converged_px:
                break
        return H

    def _look(self, patches: Patches, chosen: IdArray, gray: Gray, H: Homography) -> Correspondences:
        """Those of the chosen patches that are found again near where H says they are."""
        cur_H_ref = np.linalg.inv(H)
        measured = measure_patches(patches, chosen, gray, cur_H_ref)
        near = np.abs(measured.displacement).max(axis=1, initial=0) <= _LINEAR_PX
        found = near & (measured.correlation >= self._config.min_correlation)
        reference_px = patches.centres[chosen[found]].astype(np.float64)
        current_px = apply(cur_H_ref, reference_px + measured.displacement[found])
        return Correspondences(chosen[found], reference_px, current_px, measured.information[found], H)


def _agrees(pairs: Correspondences, H: Homography, trust: FloatArray) -> bool:
    """Whether the trusted patches agree on H as those of a picture that shows the same do.

    Where it is blurred by much more than a patch can bear, each is found somewhere near, off to the side that its own
    texture leans to: a result would look certain, by their number, and be off by pixels.
    """
    trusted = trust[pairs.feature_id] > _TRUSTED
    off_px = np.hypot(*(apply(H, pairs.current_px) - pairs.reference_px)[trusted].T)
    return len(off_px) == 0 or float(np.median(off_px)) < _SCATTERED_PX


def build_pyramid(gray: Gray) -> list[Gray]:
    """The picture, then its 2x2 averages down to `_COARSEST_PX`; an odd last row or column is left out."""
    pyramid = [gray]
    while min(pyramid[-1].shape) >= 2 * _COARSEST_PX:
        height, width = (n // 2 for n in pyramid[-1].shape)
        even = pyramid[-1][: 2 * height, : 2 * width]
        pyramid.append(np.asarray(cv2.resize(even, (width, height), interpolation=cv2.INTER_AREA)))
    return pyramid
