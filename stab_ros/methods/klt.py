"""Shi-Tomasi corners followed by the pyramidal Lucas-Kanade tracker, checked there and back.

The tracker of KLT-IV (Perks 2020, section 2.1) in OpenCV's implementation (Bouguet 2001), run from the reference
straight to the current frame with the predicted homography as the start, so that no drift accumulates. A second pass
with smaller windows starts from the first one's places: KLT-IV stabilises the stabilised frames once more, which
comes to the same without a second interpolation (Ljubicic et al. 2021, section 2.1.3).

By default the corners are spread evenly: ranked over the whole picture, most would lie where the texture is strongest,
which may be the water. KLT-IV's own selection is `quadrants`: the strongest tenth of each quadrant of the picture; its
polygon of the water (our `exclude`) is applied afterwards.
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

# Of one corner, followed with a window of 21 px; measured on synthetic scenes with 2 grey levels of noise. It falls
# with the root of the window's side.
_SIGMA_PX, _SIGMA_BLOCK = 0.1, 21
_CORNER_PX = 5  # window of the minimum eigenvalue in which KLT-IV looks for corners
_SMALLEST_BLOCK, _LARGEST_BLOCK = 5, 101


@dataclass(frozen=True)
class KltConfig(Checked):
    """Parameters `klt.*`."""

    selection: str = setting("even", "corners: spread evenly, or the strongest share of each image quadrant (KLT-IV)",
                             choices=("even", "quadrants"))
    corners: int = setting(1000, "even: number of corners to follow", 8, 10000)
    min_texture: float = setting(0.5, "even: least mean squared gradient of a window, grey levels^2 per px^2",
                                 0.01, 1e4)
    share: float = setting(0.1, "quadrants: share of a quadrant's corners that is followed, the strongest", 0.001, 1.0)
    min_quality: float = setting(0.01, "quadrants: least minimum eigenvalue of a corner, share of the largest",
                                 0.0, 1.0)
    passes: str = setting("21", "side of the window that is followed, px, of each pass in turn: 21 or 21,5")
    levels: int = setting(5, "pyramid levels of the first pass; the others go without", 1, 8)
    max_bidirectional: float = setting(0.5, "a corner that misses itself there and back by more is dropped, px",
                                       0.01, 10.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.blocks or not all(_SMALLEST_BLOCK <= block <= _LARGEST_BLOCK for block in self.blocks):
            raise ConfigError(f"klt.passes: {self.passes!r} is no list of window sizes, it must be whole numbers from "
                              f"{_SMALLEST_BLOCK} to {_LARGEST_BLOCK} with commas between them, as 21,5")

    @property
    def blocks(self) -> tuple[int, ...]:
        """Window sizes of the passes; empty if `passes` is no list of whole numbers."""
        words = self.passes.split(",")
        return tuple(map(int, words)) if all(word.strip().isdecimal() for word in words) else ()


class Klt:
    """`stab_ros.methods.Method` by corners and optical flow."""

    Config: ClassVar[type[Any]] = KltConfig
    takes_points: ClassVar[bool] = True
    seeks_all: ClassVar[bool] = True

    def __init__(self, reference: Gray, allowed: BoolArray, config: KltConfig,
                 points_px: FloatArray = NO_POINTS) -> None:
        """reference: (h, w) uint8. allowed: (h, w) bool, where corners may lie. points_px: (n, 2), or none."""
        self._config, self._reference = config, reference
        self._corners = _named(points_px, reference, config) if len(points_px) else _chosen(reference, allowed, config)

    @property
    def reference_px(self) -> FloatArray:
        return self._corners.astype(np.float64)

    def match(self, current: Gray, guess: Homography, trust: FloatArray) -> Correspondences:
        if not len(self._corners):
            return self._pairs(np.zeros(0, np.int64), np.zeros((0, 2)))
        places = apply(np.linalg.inv(guess), self.reference_px).astype(np.float32)
        found = np.ones(len(places), bool)
        for number, block in enumerate(self._config.blocks):
            levels = self._config.levels if number == 0 else 1  # a small window on a coarse level strays
            places, again = self._there_and_back(current, places, block, levels)
            found &= again
        kept = np.flatnonzero(found)
        return self._pairs(kept, places[kept].astype(np.float64))

    def _there_and_back(self, current: Gray, start: FloatArray, block: int,
                        levels: int) -> tuple[FloatArray, BoolArray]:
        """Where the corners are in the current frame, and which of them find the way back."""
        forward, seen = self._flow(self._reference, current, self._corners, start, block, levels)
        backward, seen_again = self._flow(current, self._reference, forward, self._corners, block, levels)
        error_px = np.hypot(*(backward - self._corners).T)
        return forward, seen & seen_again & (error_px <= self._config.max_bidirectional)

    @staticmethod
    def _flow(first: Gray, second: Gray, points: FloatArray, start: FloatArray, block: int,
              levels: int) -> tuple[FloatArray, BoolArray]:
        """Where `points` of the first picture are in the second, and which of them were found."""
        criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 30, 0.005)
        moved, status, _ = cv2.calcOpticalFlowPyrLK(first, second, points, start.copy(), winSize=(block, block),
                                                    maxLevel=levels - 1, criteria=criteria,
                                                    flags=cv2.OPTFLOW_USE_INITIAL_FLOW)
        return moved, status.ravel().astype(bool)

    def _pairs(self, kept: IdArray, current_px: FloatArray) -> Correspondences:
        variance = _SIGMA_PX**2 * _SIGMA_BLOCK / self._config.blocks[-1]
        information = np.tile(np.eye(2) / variance, (len(kept), 1, 1))
        return Correspondences(kept, self.reference_px[kept], current_px, information)


def _named(points_px: FloatArray, reference: Gray, config: KltConfig) -> FloatArray:
    """Those of the user's points whose windows lie inside the picture, float32."""
    side = config.blocks[0] // 2 * 2
    room = inside(points_px - side // 2, (reference.shape[1] - side, reference.shape[0] - side))
    return points_px[room].astype(np.float32)


def _chosen(reference: Gray, allowed: BoolArray, config: KltConfig) -> FloatArray:
    """The corners that `selection` finds, float32."""
    if config.selection == "quadrants":
        return strongest_of_quadrants(reference, allowed, config.share, config.min_quality).astype(np.float32)
    radius = config.blocks[0] // 2
    return spread.choose(reference, allowed, config.corners, radius, config.min_texture).astype(np.float32)


def strongest_of_quadrants(gray: Gray, allowed: BoolArray, share: float, min_quality: float) -> IdArray:
    """Corners (n, 2) as KLT-IV chooses them (Ljubicic et al. 2021, section 2.1.3).

    Of each quadrant of the picture the `share` with the largest minimum eigenvalues, and of these what is `allowed`.
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
    """The share of the indices `which` with the largest strength."""
    order = np.argsort(-strength[which], kind="stable")
    return which[order[: round(share * len(which))]]
