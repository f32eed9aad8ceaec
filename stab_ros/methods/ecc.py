"""Alignment by the enhanced correlation coefficient (Evangelidis and Psarakis 2008), coarse to fine; slow and exact.

The yardstick of accuracy: every allowed pixel of the reference takes part in one homography, with OpenCV's
implementation on every level of a pyramid. It has no defence against what moves, so `exclude` must keep the water out.
Patches of the reference report where the homography puts them; how much they look like the reference says how certain
they are, and whether the frame shows the same place at all.
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
_COUNT = 2400  # patches
_FARTHEST_PX = 1.0  # a patch that still lies further off is no confirmation
_MEDIAN_CHI2 = 1.386  # of two degrees of freedom
_FEWEST_PX = 1000  # allowed pixels of a coarse level that can be aligned


@dataclass(frozen=True)
class EccConfig(Checked):
    """Parameters `ecc.*`."""

    levels: int = setting(4, "pyramid levels", 1, 8)
    iterations: int = setting(50, "most iterations a level", 1, 1000)
    epsilon: float = setting(1e-6, "a level is done when the correlation grows by less", 1e-12, 0.01)
    blur: int = setting(2, "radius of the Gaussian that smooths both pictures, px", 0, 10)
    min_correlation: float = setting(0.5, "a frame, and a patch, that looks less like the reference is not found",
                                     0.0, 1.0)
    min_texture: float = setting(0.5, "least mean squared gradient of a patch, grey levels^2 per px^2", 0.01, 1e4)


@dataclass(frozen=True, eq=False)
class Level:
    """The reference on one level of the pyramid. mask: (h, w) uint8, 255 where it may be looked at."""

    reference: Gray
    mask: Gray
    scale: Homography


class Ecc:
    """`stab_ros.methods.Method` by OpenCV's ECC."""

    Config: ClassVar[type[Any]] = EccConfig
    takes_points: ClassVar[bool] = False  # it aligns all of the picture
    seeks_all: ClassVar[bool] = True

    def __init__(self, reference: Gray, allowed: BoolArray, config: EccConfig,
                 points_px: FloatArray = NO_POINTS) -> None:
        """reference: (h, w) uint8. allowed: (h, w) bool, what is static. It takes no `points_px`."""
        self._config = config
        centres = spread.choose(reference, allowed, _COUNT, _RADIUS_PX, config.min_texture)
        self._patches = cut_patches(reference, centres, _RADIUS_PX)
        self.reference_px: FloatArray = self._patches.centres.astype(np.float64)
        pyramid = build_pyramid(reference)[: config.levels]
        self._levels = [_level(gray, allowed, k) for k, gray in enumerate(pyramid)]

    def match(self, current: Gray, guess: Homography, trust: FloatArray) -> Correspondences:
        H: Homography | None = guess
        pyramid = build_pyramid(current)
        for k in reversed(range(len(self._levels))):
            H = None if H is None else self._aligned(pyramid[k], self._levels[k], H, last=k == 0)
        return self._confirmed(current, H)

    def _aligned(self, gray: Gray, level: Level, guess: Homography, last: bool) -> Homography | None:
        """`guess` corrected on one level; as it is where a coarse level shows too little, None where that fails."""
        if not last and cv2.countNonZero(level.mask) < _FEWEST_PX:
            return guess
        H = normalized(level.scale @ guess @ np.linalg.inv(level.scale)).astype(np.float32)
        correlation, H = self._maximised(gray, level, H)
        H = normalized(np.linalg.inv(level.scale) @ H.astype(np.float64) @ level.scale)
        enough = correlation >= self._config.min_correlation
        return H if enough and is_plausible(H, self._levels[0].reference.shape[::-1]) else None

    def _maximised(self, gray: Gray, level: Level, H: Homography) -> tuple[float, Homography]:
        """The correlation and the homography (float32) of largest correlation; -1 where it cannot be improved.

        The frame is OpenCV's template and the reference its input, since its mask lies on the input.
        """
        config = self._config
        criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, config.iterations, config.epsilon)
        try:
            return cv2.findTransformECC(gray, level.reference, H, cv2.MOTION_HOMOGRAPHY, criteria, level.mask,
                                        2 * config.blur + 1)
        except cv2.error:  # it diverges
            return -1.0, H

    def _confirmed(self, current: Gray, H: Homography | None) -> Correspondences:
        """The patches that show the reference where H puts them."""
        if H is None:
            nothing = np.zeros((0, 2))
            return Correspondences(np.zeros(0, np.int64), nothing, nothing, np.zeros((0, 2, 2)))
        cur_H_ref = np.linalg.inv(H)
        measured = measure_patches(self._patches, np.arange(len(self._patches)), current, cur_H_ref)
        near = np.hypot(*measured.displacement.T) <= _FARTHEST_PX
        found = np.flatnonzero(near & (measured.correlation >= self._config.min_correlation))
        reference_px = self.reference_px[found]
        information = _honest(measured.displacement[found], measured.information[found])
        return Correspondences(found, reference_px, apply(cur_H_ref, reference_px), information)


def _honest(displacement: FloatArray, information: FloatArray) -> FloatArray:
    """(n, 2, 2) information, less where the patches lie further from the homography (n, 2) than it claims.

    What is reported lies on the homography, so its residuals no longer show that.
    """
    squared = np.einsum("ni,nij,nj->n", displacement, information, displacement)
    excess = float(np.median(squared)) / _MEDIAN_CHI2 if len(squared) else 1.0
    return np.asarray(information / max(1.0, excess))


def _level(gray: Gray, allowed: BoolArray, level: int) -> Level:
    """A pixel of a coarse level may be looked at if all that it is made of may."""
    block = 2**level
    height, width = gray.shape
    even = allowed[: height * block, : width * block].astype(np.float32)
    share = cv2.resize(even, (width, height), interpolation=cv2.INTER_AREA)
    return Level(gray, np.where(share > 0.999, 255, 0).astype(np.uint8), level_scale(level))
