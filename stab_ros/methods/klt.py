"""Shi-Tomasi corners tracked by pyramidal Lucas-Kanade optical flow with a forward-backward check.

The tracker of KLT-IV (Perks 2020, section 2.1) in OpenCV's implementation (Bouguet 2001). It runs directly from the
reference to the current frame, starting at the predicted homography, so that no drift accumulates. A second pass with
smaller windows starts from the result of the first one. KLT-IV stabilizes the stabilized frames a second time instead,
which is equivalent but interpolates twice (Ljubicic et al. 2021, section 2.1.3).

By default the corners are spread evenly. Ranked over the whole image, most corners would lie where the texture is
strongest, which may be the water. KLT-IV selects by `quadrants`: the strongest tenth of each image quadrant, from which
its polygon of the water (here `exclude`) is removed afterwards.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import cv2
import numpy as np

from stab_ros.core.errors import ConfigError
from stab_ros.core.geometry import apply, inside
from stab_ros.core.settings import Checked, setting
from stab_ros.core.types import NO_POINTS, BoolArray, Correspondences, FloatArray, Gray, Homography, IdArray
from stab_ros.methods import spread

# Standard deviation of a corner tracked with a window of 21 px, measured on synthetic scenes with noise of 2 grey
# levels; proportional to the inverse square root of the window's side.
_SIGMA_PX, _SIGMA_BLOCK = 0.1, 21
_CORNER_PX = 5  # window of KLT-IV's minimum-eigenvalue corner detector
_SMALLEST_BLOCK, _LARGEST_BLOCK = 5, 101


@dataclass(frozen=True)
class KltConfig(Checked):
    """Parameters `klt.*`."""

    selection: str = setting("even", "Corner selection: spread evenly, or the strongest share of each image quadrant "
                                     "(KLT-IV)", choices=("even", "quadrants"))
    corners: int = setting(1000, "With selection even: number of corners to track", 8, 10000)
    min_texture: float = setting(0.5, "With selection even: minimum mean squared gradient of a window, "
                                      "grey levels^2 per px^2", 0.01, 1e4)
    share: float = setting(0.1, "With selection quadrants: share of a quadrant's corners to track, strongest first",
                           0.001, 1.0)
    min_quality: float = setting(0.01, "With selection quadrants: minimum eigenvalue of a corner, as a share of the "
                                       "largest", 0.0, 1.0)
    passes: str = setting("21", "Window sides of successive passes, separated by commas, such as 21 or 21,5, px")
    levels: int = setting(5, "Number of pyramid levels of the first pass; later passes use full resolution only", 1, 8)
    max_bidirectional: float = setting(0.5, "Maximum forward-backward error of a corner, px", 0.01, 10.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.blocks or not all(_SMALLEST_BLOCK <= block <= _LARGEST_BLOCK for block in self.blocks):
            raise ConfigError(f"klt.passes: {self.passes!r} is no list of window sizes, it must be whole numbers from "
                              f"{_SMALLEST_BLOCK} to {_LARGEST_BLOCK} with commas between them, as 21,5")

    @property
    def blocks(self) -> tuple[int, ...]:
        """Window sides of the passes, px; empty if `passes` is not a list of whole numbers."""
        words = self.passes.strip(" []").split(",")
        return tuple(map(int, words)) if all(word.strip().isdecimal() for word in words) else ()


class Klt:
    """`stab_ros.methods.Method` by corners and optical flow."""

    Config: ClassVar[type[Any]] = KltConfig
    takes_points: ClassVar[bool] = True
    seeks_all: ClassVar[bool] = True

    def __init__(self, reference: Gray, allowed: BoolArray, config: KltConfig,
                 points_px: FloatArray = NO_POINTS) -> None:
        """Detects the corners.

        Args:
            reference: (h, w) uint8.
            allowed: (h, w) bool, where corners may lie.
            config: parameters.
            points_px: (n, 2), corners given by the user, px; n = 0 for automatic ones.
        """
        self._config, self._reference = config, reference
        self._corners = (_user_corners(points_px, reference, config) if len(points_px) else
                         _detected_corners(reference, allowed, config))

    @property
    def reference_px(self) -> FloatArray:
        return self._corners.astype(np.float64)

    def match(self, current: Gray, guess: Homography, trust: FloatArray) -> Correspondences:
        if not len(self._corners):
            return self._pairs(np.zeros(0, np.int64), np.zeros((0, 2)))
        places = apply(np.linalg.inv(guess), self.reference_px).astype(np.float32)
        found = np.ones(len(places), bool)
        for number, block in enumerate(self._config.blocks):
            levels = self._config.levels if number == 0 else 1  # small windows fail on coarse levels
            places, consistent = self._forward_backward(current, places, block, levels)
            found &= consistent
        kept = np.flatnonzero(found)
        return self._pairs(kept, places[kept].astype(np.float64))

    def _forward_backward(self, current: Gray, start: FloatArray, block: int,
                        levels: int) -> tuple[FloatArray, BoolArray]:
        """Positions of the corners in the current frame, and which of them pass the forward-backward check."""
        forward, found_forward = self._flow(self._reference, current, self._corners, start, block, levels)
        backward, found_backward = self._flow(current, self._reference, forward, self._corners, block, levels)
        error_px = np.hypot(*(backward - self._corners).T)
        return forward, found_forward & found_backward & (error_px <= self._config.max_bidirectional)

    @staticmethod
    def _flow(first: Gray, second: Gray, points: FloatArray, start: FloatArray, block: int,
              levels: int) -> tuple[FloatArray, BoolArray]:
        """Positions in the second image of `points` of the first one, and which of them were found."""
        criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 30, 0.005)
        moved, status, _ = cv2.calcOpticalFlowPyrLK(first, second, points, start.copy(), winSize=(block, block),
                                                    maxLevel=levels - 1, criteria=criteria,
                                                    flags=cv2.OPTFLOW_USE_INITIAL_FLOW)
        return moved, status.ravel().astype(bool)

    def _pairs(self, kept: IdArray, current_px: FloatArray) -> Correspondences:
        variance = _SIGMA_PX**2 * _SIGMA_BLOCK / self._config.blocks[-1]
        information = np.tile(np.eye(2) / variance, (len(kept), 1, 1))
        return Correspondences(kept, self.reference_px[kept], current_px, information)


def _user_corners(points_px: FloatArray, reference: Gray, config: KltConfig) -> FloatArray:
    """The user's points whose windows lie inside the image, float32."""
    side = config.blocks[0] // 2 * 2
    room = inside(points_px - side // 2, (reference.shape[1] - side, reference.shape[0] - side))
    return points_px[room].astype(np.float32)


def _detected_corners(reference: Gray, allowed: BoolArray, config: KltConfig) -> FloatArray:
    """The automatic corners by `selection`, float32."""
    if config.selection == "quadrants":
        return strongest_of_quadrants(reference, allowed, config.share, config.min_quality).astype(np.float32)
    radius = config.blocks[0] // 2
    return spread.choose(reference, allowed, config.corners, radius, config.min_texture).astype(np.float32)


def strongest_of_quadrants(gray: Gray, allowed: BoolArray, share: float, min_quality: float) -> IdArray:
    """Corners (n, 2) int64, px, by the selection of KLT-IV (Ljubicic et al. 2021, section 2.1.3).

    The `share` of the corners of each image quadrant with the largest minimum eigenvalues, restricted to `allowed`
    afterwards. gray: (h, w) uint8. allowed: (h, w) bool. min_quality: see `KltConfig`.
    """
    eigenvalue = cv2.cornerMinEigenVal(gray, _CORNER_PX)
    least = max(min_quality * float(eigenvalue.max(initial=0)), np.finfo(np.float32).tiny)
    peak = (eigenvalue == cv2.dilate(eigenvalue, np.ones((3, 3), np.uint8))) & (eigenvalue >= least)
    row, column = np.nonzero(peak)
    quadrant = 2 * (row >= gray.shape[0] // 2) + (column >= gray.shape[1] // 2)
    strength = eigenvalue[row, column]
    best = [_strongest(np.flatnonzero(quadrant == number), strength, share) for number in range(4)]
    chosen = np.sort(np.concatenate(best))
    corners = np.stack([column[chosen], row[chosen]], axis=1).astype(np.int64)
    return corners[allowed[row[chosen], column[chosen]]]


def _strongest(which: IdArray, strength: FloatArray, share: float) -> IdArray:
    """The `share` of the indices `which` with the largest strength."""
    order = np.argsort(-strength[which], kind="stable")
    return which[order[: round(share * len(which))]]
