"""Alignment by the enhanced correlation coefficient (ECC, Evangelidis and Psarakis 2008), coarse to fine; slow, exact.

A baseline for accuracy: one homography is fitted to every allowed pixel of the reference, with OpenCV's implementation
on each level of a pyramid. It is not robust to moving regions, so `exclude` must mask the water. The correspondences
are patches of the reference at their positions under the homography. Their correlation with the frame gives their
uncertainty, and shows whether the frame shows the same scene.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import cv2
import numpy as np

from stab_ros.core.geometry import apply, is_plausible, level_scale, normalized
from stab_ros.core.settings import Checked, setting
from stab_ros.core.types import NO_POINTS, BoolArray, Correspondences, FloatArray, Gray, Homography
from stab_ros.methods import spread
from stab_ros.methods.direct import build_pyramid
from stab_ros.methods.patches import cut_patches, measure_patches

_RADIUS_PX = 8  # half the side of a patch
_PATCHES = 2400  # patches
_MAX_RESIDUAL_PX = 1.0  # patches with a larger displacement are dropped
_MEDIAN_CHI2 = 1.386  # median of chi-square with two degrees of freedom
_MIN_ALLOWED_PX = 1000  # coarse levels with fewer allowed pixels are skipped


@dataclass(frozen=True)
class EccConfig(Checked):
    """Parameters `ecc.*`."""

    levels: int = setting(4, "Number of pyramid levels", 1, 8)
    iterations: int = setting(50, "Maximum number of iterations per level", 1, 1000)
    epsilon: float = setting(1e-6, "Convergence threshold on the increase of the correlation coefficient", 1e-12, 0.01)
    blur: int = setting(2, "Radius of the Gaussian that smooths both images, px", 0, 10)
    min_correlation: float = setting(0.5, "Minimum correlation of the frame, and of each patch, with the reference",
                                     0.0, 1.0)
    min_texture: float = setting(0.5, "Minimum mean squared gradient of a patch, grey levels^2 per px^2", 0.01, 1e4)


@dataclass(frozen=True, eq=False)
class EccLevel:
    """The reference on one level of the pyramid.

    Attributes:
        reference: (h, w) uint8.
        mask: (h, w) uint8, 255 for pixels that take part.
        scale: homography from full-resolution pixels to those of the level.
    """

    reference: Gray
    mask: Gray
    scale: Homography


class Ecc:
    """`stab_ros.methods.Method` by OpenCV's ECC."""

    Config: ClassVar[type[Any]] = EccConfig
    takes_points: ClassVar[bool] = False  # it aligns the whole image
    seeks_all: ClassVar[bool] = True

    def __init__(self, reference: Gray, allowed: BoolArray, config: EccConfig,
                 points_px: FloatArray = NO_POINTS) -> None:
        """Builds the pyramid of the reference and chooses patches.

        Args:
            reference: (h, w) uint8.
            allowed: (h, w) bool, the static region.
            config: parameters.
            points_px: not used.
        """
        self._config = config
        centres = spread.choose(reference, allowed, _PATCHES, _RADIUS_PX, config.min_texture)
        self._patches = cut_patches(reference, centres, _RADIUS_PX)
        self.reference_px: FloatArray = self._patches.centres.astype(np.float64)
        pyramid = build_pyramid(reference)[: config.levels]
        self._levels = [_level(gray, allowed, k) for k, gray in enumerate(pyramid)]

    def match(self, current: Gray, guess: Homography, trust: FloatArray) -> Correspondences:
        H: Homography | None = guess
        pyramid = build_pyramid(current)
        for k in reversed(range(len(self._levels))):
            H = None if H is None else self._align_level(pyramid[k], self._levels[k], H, last=k == 0)
        return self._verified_patches(current, H)

    def _align_level(self, gray: Gray, level: EccLevel, guess: Homography, last: bool) -> Homography | None:
        """`guess` refined on one level; None where that fails.

        It is returned unchanged for a coarse level with too few allowed pixels.
        """
        if not last and cv2.countNonZero(level.mask) < _MIN_ALLOWED_PX:
            return guess
        H = normalized(level.scale @ guess @ np.linalg.inv(level.scale)).astype(np.float32)
        correlation, H = self._maximize_correlation(gray, level, H)
        H = normalized(np.linalg.inv(level.scale) @ H.astype(np.float64) @ level.scale)
        enough = correlation >= self._config.min_correlation
        return H if enough and is_plausible(H, self._levels[0].reference.shape[::-1]) else None

    def _maximize_correlation(self, gray: Gray, level: EccLevel, H: Homography) -> tuple[float, Homography]:
        """The maximum of the correlation coefficient and its homography (float32); -1 where the iteration diverges.

        The frame is OpenCV's template image and the reference its input image, because its mask refers to the input.
        """
        config = self._config
        criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, config.iterations, config.epsilon)
        try:
            return cv2.findTransformECC(gray, level.reference, H, cv2.MOTION_HOMOGRAPHY, criteria, level.mask,
                                        2 * config.blur + 1)
        except cv2.error:  # it diverges
            return -1.0, H

    def _verified_patches(self, current: Gray, H: Homography | None) -> Correspondences:
        """Correspondences of the patches that match the frame at their positions under H."""
        if H is None:
            nothing = np.zeros((0, 2))
            return Correspondences(np.zeros(0, np.int64), nothing, nothing, np.zeros((0, 2, 2)))
        cur_H_ref = np.linalg.inv(H)
        measured = measure_patches(self._patches, np.arange(len(self._patches)), current, cur_H_ref)
        near = np.hypot(*measured.displacement.T) <= _MAX_RESIDUAL_PX
        found = np.flatnonzero(near & (measured.correlation >= self._config.min_correlation))
        reference_px = self.reference_px[found]
        information = _with_residual_excess(measured.displacement[found], measured.information[found])
        return Correspondences(found, reference_px, apply(cur_H_ref, reference_px), information)


def _with_residual_excess(displacement: FloatArray, information: FloatArray) -> FloatArray:
    """Information matrices (n, 2, 2), scaled down where the residual displacements (n, 2) exceed their uncertainty.

    The reported correspondences lie exactly on the homography, so their residuals cannot show this later.
    """
    squared = np.einsum("ni,nij,nj->n", displacement, information, displacement)
    excess = float(np.median(squared)) / _MEDIAN_CHI2 if len(squared) else 1.0
    return np.asarray(information / max(1.0, excess))


def _level(gray: Gray, allowed: BoolArray, level: int) -> EccLevel:
    """One level of the reference. A coarse pixel takes part if all full-resolution pixels in it are allowed."""
    block = 2**level
    height, width = gray.shape
    even = allowed[: height * block, : width * block].astype(np.float32)
    share = cv2.resize(even, (width, height), interpolation=cv2.INTER_AREA)
    return EccLevel(gray, np.where(share > 0.999, 255, 0).astype(np.uint8), level_scale(level))
