"""Direct alignment of 2400 patches (parameter `direct.patches`) of the reference to the current frame; the default.

Each patch measures its displacement in the current frame through the gradient of its template, with the information
matrix of that displacement (structure tensor over measured noise). All patches together correct one homography, coarse
to fine over an image pyramid and then at full resolution until it converges. This is joint inverse compositional
Gauss-Newton (Baker and Matthews 2004) with robust weights on displacements in px rather than on grey levels. Water that
moves with an intact texture is therefore separated from ground. Only the pyramid reads every pixel of a frame.

The robust weights inside the alignment use fixed inlier thresholds: 0.5 px at full resolution, and 1 px (of the level)
on the coarser pyramid levels. The parameter `threshold` does not change them. It applies to the fit of the reported
correspondences afterwards.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, ClassVar

import cv2
import numpy as np

from stab_ros.core.geometry import apply, level_scale, normalized, rms_distance
from stab_ros.core.row_shifts import RowShifts
from stab_ros.core.settings import Checked, setting
from stab_ros.core.types import NO_POINTS, BoolArray, Correspondences, FloatArray, Gray, Homography, IdArray
from stab_ros.estimation import estimators
from stab_ros.estimation.models import MODELS, minimal_points
from stab_ros.methods import spread
from stab_ros.methods.patches import Patches, cut_patches, measure_patches

_COARSEST_PX = 60  # shortest side of a pyramid level
_COARSE_PATCHES = 150  # on each coarser level
_ALIGNING_PATCHES = 400  # at full resolution; all patches are measured only once, after convergence
_MIN_TRUST = 0.3
_MIN_FOUND_SHARE = 0.6  # of the patches; with fewer, the alignment starts on the pyramid
_MAX_DISPLACEMENT_PX = 2.0  # the linearization of a patch does not hold beyond


@dataclass(frozen=True)
class PassSchedule:
    """Iterations of an alignment.

    Attributes:
        max_steps: largest number of Gauss-Newton steps.
        model: transformation model of the correction.
        threshold_px: inlier threshold of the robust weights; fixed, and independent of the parameter `threshold`.
        converged_px: RMS change of the homography over the frame below which the iteration stops.
    """

    max_steps: int
    model: str
    threshold_px: float
    converged_px: float


_COARSE = PassSchedule(3, "affine", 1.0, 0.2)
_FINE = PassSchedule(4, "projective", 0.5, 0.01)


def _fine_schedule(patches: int) -> PassSchedule:
    """The iterations at full resolution, with the most general model that so many patches determine."""
    models = [model for model in MODELS if minimal_points(model) <= patches]
    return replace(_FINE, model=models[-1]) if models else _FINE


@dataclass(frozen=True, eq=False)
class PatchLevel:
    """One coarser level of the pyramid.

    Attributes:
        patches: patches of this level.
        scale: homography from full-resolution pixels to those of the level.
        overlaps: (n, 2) int64, index of a patch of the level and of a full-resolution patch whose centre lies in it.
    """

    patches: Patches
    scale: Homography
    overlaps: IdArray

    def trust(self, fine: FloatArray) -> FloatArray:
        """Prior weights (N,) of the level's patches: the mean trust `fine` of the full-resolution patches inside each.

        It is 0 where that mean is too low, and 1 for a patch without any full-resolution patches.
        """
        coarse_patch, fine_patch = self.overlaps.T
        count = np.bincount(coarse_patch, minlength=len(self.patches))
        total = np.bincount(coarse_patch, fine[fine_patch], minlength=len(self.patches))
        mean = np.where(count > 0, total / np.maximum(count, 1), 1.0)
        return np.where(mean > _MIN_TRUST, mean, 0.0)


@dataclass(frozen=True)
class DirectConfig(Checked):
    """Parameters `direct.*`.

    The inlier threshold of the alignment itself (0.5 px, 1 px on coarser levels) is fixed; `threshold` applies to the
    final fit.
    """

    patches: int = setting(2400, "Number of patches, spread evenly; their alignment uses a fixed inlier threshold of "
                                 "0.5 px, `threshold` applies to the fit afterwards", 16, 20000)
    radius: int = setting(8, "Half the side of a patch (8 gives 17x17 pixels), px", 3, 20)
    min_correlation: float = setting(0.5, "Minimum correlation of a patch with its template", 0.1, 0.99)
    min_texture: float = setting(0.5, "Minimum mean squared gradient of a patch, grey levels^2 per px^2", 0.01, 1e4)
    subset: str = setting("all", "Subset of the patches to use; the two disjoint halves allow a cross-check",
                          choices=("all", "even", "odd"))


class Direct:
    """`stab_ros.methods.Method` by direct alignment."""

    Config: ClassVar[type[Any]] = DirectConfig
    takes_points: ClassVar[bool] = True
    seeks_all: ClassVar[bool] = True

    def __init__(self, reference: Gray, allowed: BoolArray, config: DirectConfig,
                 points_px: FloatArray = NO_POINTS) -> None:
        """Cuts the patches of all pyramid levels.

        Args:
            reference: (h, w) uint8.
            allowed: (h, w) bool, where patches may lie.
            config: parameters.
            points_px: (n, 2), patch centres given by the user, px, rounded to whole pixels; n = 0 for automatic ones.
                The patches of the coarser levels are always automatic.
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

    def _level(self, gray: Gray, allowed: BoolArray, level: int) -> PatchLevel:
        radius = self._config.radius
        small = cv2.resize(allowed.astype(np.uint8), gray.shape[::-1], interpolation=cv2.INTER_NEAREST).astype(bool)
        centres = spread.choose(gray, small, _COARSE_PATCHES, radius, self._config.min_texture)
        scale = level_scale(level)
        patches = cut_patches(gray, centres, radius)
        apart = np.abs(apply(scale, self.reference_px)[None] - patches.centres[:, None]).max(axis=2, initial=0)
        return PatchLevel(patches, scale, np.argwhere(apart <= radius))

    def match(self, current: Gray, guess: Homography, trust: FloatArray) -> Correspondences:
        """Correspondences of all patches after the alignment; see `Method.match`.

        The pyramid is used only if few patches are found at the predicted homography. Coarse patches contain water
        next to ground more often, so they would not improve a good prediction.
        """
        chosen = self._alignment_subset(trust)
        H, measured = guess, self._measure(self._fine, chosen, current, guess)
        if len(measured) <= _MIN_FOUND_SHARE * len(chosen):
            H = self._align_coarse(current, guess, trust)
            measured = self._measure(self._fine, chosen, current, H)
        better = self._align(self._fine, measured, chosen, current, H, trust, _fine_schedule(len(chosen)))
        H = H if better is None else better
        return self._measure(self._fine, np.arange(len(self._fine)), current, H)

    def measure(self, current: Gray, ref_H_cur: Homography, rows: RowShifts | None) -> Correspondences:
        """Correspondences of all patches near a known place; see `RowMethod.measure`."""
        return self._measure(self._fine, np.arange(len(self._fine)), current, ref_H_cur, rows)

    def _align_coarse(self, gray: Gray, guess: Homography, trust: FloatArray) -> Homography:
        """`guess` refined over the pyramid, from its coarsest level to the one below full resolution."""
        H = guess
        for small, level in zip(reversed(build_pyramid(gray)[1:]), self._coarse, strict=True):
            H = self._align_level(small, level, H, trust)
        return H

    def _align_level(self, gray: Gray, level: PatchLevel, guess: Homography, trust: FloatArray) -> Homography:
        """`guess` refined on one pyramid level; unchanged where the level does not determine a homography."""
        H = normalized(level.scale @ guess @ np.linalg.inv(level.scale))
        all_patches = np.arange(len(level.patches))
        measured = self._measure(level.patches, all_patches, gray, H)
        better = self._align(level.patches, measured, all_patches, gray, H, level.trust(trust), _COARSE)
        return guess if better is None else normalized(np.linalg.inv(level.scale) @ better @ level.scale)

    @staticmethod
    def _alignment_subset(trust: FloatArray) -> IdArray:
        """Indices of an evenly spaced subset of the trusted patches."""
        trusted = np.flatnonzero(trust > _MIN_TRUST)
        return trusted[:: max(1, len(trusted) // _ALIGNING_PATCHES)]

    def _align(self, patches: Patches, measured: Correspondences, chosen: IdArray, gray: Gray, H: Homography,
               trust: FloatArray, schedule: PassSchedule) -> Homography | None:
        """H after Gauss-Newton steps that start from `measured`, the displacements at H; None where a step fails."""
        for step in range(schedule.max_steps):
            pairs = self._measure(patches, chosen, gray, H) if step else measured
            better = estimators.refine(pairs, schedule.model, schedule.threshold_px, H, trust[pairs.feature_id])
            if better is None:
                return None
            moved, H = rms_distance(better, H, gray.shape[::-1]), better
            if moved < schedule.converged_px:
                break
        return H

    def _measure(self, patches: Patches, chosen: IdArray, gray: Gray, H: Homography,
                 rows: RowShifts | None = None) -> Correspondences:
        """Correspondences of those chosen patches that are found near their positions under H and the rows."""
        cur_H_ref = np.linalg.inv(H)
        at_px = None if rows is None else rows.before(apply(cur_H_ref, patches.centres[chosen].astype(np.float64)))
        measured = measure_patches(patches, chosen, gray, cur_H_ref, at_px)
        near = np.abs(measured.displacement).max(axis=1, initial=0) <= _MAX_DISPLACEMENT_PX
        found = near & (measured.correlation >= self._config.min_correlation)
        reference_px = patches.centres[chosen[found]].astype(np.float64)
        current_px = apply(cur_H_ref, reference_px + measured.displacement[found])
        if at_px is not None and rows is not None:
            current_px -= rows.at(at_px[found, 1])
        return Correspondences(chosen[found], reference_px, current_px, measured.information[found], H)


def build_pyramid(gray: Gray) -> list[Gray]:
    """The image (h, w) uint8 and its successive 2x2 averages, while both sides are at least 60 px.

    An odd last row or column is left out.
    """
    pyramid = [gray]
    while min(pyramid[-1].shape) >= 2 * _COARSEST_PX:
        height, width = (n // 2 for n in pyramid[-1].shape)
        even = pyramid[-1][: 2 * height, : 2 * width]
        pyramid.append(np.asarray(cv2.resize(even, (width, height), interpolation=cv2.INTER_AREA)))
    return pyramid
