"""What the descriptor methods share: detection, mutual nearest-neighbour matching and spatial spreading of key points.

Two descriptors match if each is the other's nearest neighbour and both pass the ratio test (Lowe 2004, section 7.1).
A key point with two orientations has two descriptors but counts as one measurement, so there is one match per location.
Matching does not use the predicted homography. It therefore works after a jump or a rotation of the camera, too.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar, TypeAlias

import cv2
import numpy as np

from stab_ros.core.errors import InputError
from stab_ros.core.types import BoolArray, Correspondences, FloatArray, Gray, Homography, IdArray, Image

_KEY_POINTS_PER_CELL = 4  # mean number of key points per cell of the grid over which they are spread


@dataclass(frozen=True, eq=False)
class Features:
    """Key points of one image.

    Attributes:
        px: (N, 2) float64 positions, px; pixel centres are at integer coordinates.
        sigma_px: (N,) float64 standard deviation of the position along either axis, px.
        descriptor: (N, k) float32, or uint8 for binary descriptors.
    """

    px: FloatArray
    sigma_px: FloatArray
    descriptor: Image

    def __len__(self) -> int:
        return len(self.px)

    def __getitem__(self, keep: BoolArray | IdArray) -> Features:
        return Features(self.px[keep], self.sigma_px[keep], self.descriptor[keep])


Detector: TypeAlias = Callable[[Gray], Features]


@dataclass(frozen=True)
class MatchRule:
    """When two descriptors match.

    Attributes:
        ratio: largest ratio of the nearest to the second nearest distance, tested in both directions.
        norm: OpenCV norm of the descriptor distance.
        max_distance: largest distance of a match, in units of the norm.
    """

    ratio: float
    norm: int = cv2.NORM_L2
    max_distance: float = float("inf")


class CachedDetector:
    """A `Detector` that keeps the features of the last image, because one frame may be matched several times."""

    def __init__(self, detect: Detector) -> None:
        self._detect_cached = detect
        self._last: tuple[Gray, Features] | None = None

    def __call__(self, gray: Gray) -> Features:
        if self._last is None or not np.array_equal(self._last[0], gray):
            self._last = gray.copy(), self._detect_cached(gray)
        return self._last[1]


class DescriptorMethod:
    """Base of the `Method`s that detect, describe and match key points; a feature is a distinct key point location."""

    takes_points: ClassVar[bool] = False  # the detector chooses the features
    seeks_all: ClassVar[bool] = False

    def __init__(self, features: Features, detect: Detector, rule: MatchRule) -> None:
        """features: key points of the reference. detect: detector for the frames. rule: when descriptors match."""
        self._features, self._detect_cached, self._rule = features, CachedDetector(detect), rule
        self.reference_px: FloatArray
        self.reference_px, location = np.unique(features.px, axis=0, return_inverse=True)
        self._location = location.reshape(-1)

    def match(self, current: Gray, guess: Homography, trust: FloatArray) -> Correspondences:
        now = self._detect_cached(current)
        one, other = match_mutually(self._features, now, self._rule)
        feature_id = self._location[one]
        variance = self._features.sigma_px[one] ** 2 + now.sigma_px[other] ** 2
        information = np.eye(2) / variance[:, None, None]
        return Correspondences(feature_id, self.reference_px[feature_id], now.px[other], information)


def within(features: Features, allowed: BoolArray) -> Features:
    """The features whose nearest pixel is `allowed`, (h, w) bool."""
    column, row = np.round(features.px).astype(np.int64).T
    return features[allowed[row, column]]


def match_mutually(ones: Features, others: Features, rule: MatchRule) -> tuple[IdArray, IdArray]:
    """Indices (n,) int64 into both sets of the mutual matches by `rule`, one per location, nearest first."""
    nothing = np.empty(0, np.int64), np.empty(0, np.int64)
    if not len(ones) or not len(others):
        return nothing
    there, distance, distinctive = _nearest(ones.descriptor, others.descriptor, rule)
    one = np.flatnonzero(distinctive)
    if not len(one):
        return nothing
    back, _, back_distinctive = _nearest(others.descriptor[there[one]], ones.descriptor, rule)
    one = one[back_distinctive & (back == one)]
    one = one[np.argsort(distance[one], kind="stable")]
    once = _first_per_location(ones.px[one])
    once = once[_first_per_location(others.px[there[one[once]]])]
    return one[once], there[one[once]]


def _nearest(ones: Image, others: Image, rule: MatchRule) -> tuple[IdArray, FloatArray, BoolArray]:
    """For each of `ones`: index of its nearest neighbour, its distance, and whether it passes the ratio test."""
    kind = cv2.CV_32S if rule.norm == cv2.NORM_HAMMING else cv2.CV_32F
    distance, index = cv2.batchDistance(ones, others, kind, None, None, rule.norm, min(2, len(others)))
    best = distance[:, 0].astype(np.float64)
    second = distance[:, 1] if len(others) > 1 else np.full(len(ones), np.inf)
    return index[:, 0].astype(np.int64), best, (best <= rule.max_distance) & (best < rule.ratio * second)


def _first_per_location(px: FloatArray) -> IdArray:
    """Indices, ascending, of the first feature at each location."""
    return np.asarray(np.sort(np.unique(px, axis=0, return_index=True)[1]))


def spread_evenly(px: FloatArray, response: FloatArray, count: int, shape: tuple[int, ...]) -> IdArray:
    """Indices (n,), ascending, of at most `count` points spread over a regular grid.

    First the strongest point of each cell, then the second strongest, and so on.

    Args:
        px: (N, 2) positions, px.
        response: (N,) detector response.
        count: largest number of points.
        shape: (h, w) of the image.
    """
    if len(px) <= count:
        return np.arange(len(px))
    side = max(1.0, float(np.sqrt(_KEY_POINTS_PER_CELL * shape[0] * shape[1] / count)))
    column, row = np.floor(np.maximum(px, 0) / side).astype(np.int64).T
    cell = row * (int(shape[1] / side) + 2) + column
    order = np.lexsort((-response, cell))
    starts = np.flatnonzero(np.diff(cell[order], prepend=-1))
    rank = np.arange(len(px)) - np.repeat(starts, np.diff(starts, append=len(px)))
    best = np.lexsort((-response[order], rank))[:count]
    return np.asarray(np.sort(order[best]))


def contrib(name: str) -> Any:
    """`cv2.<name>` or `cv2.xfeatures2d.<name>`, depending on the version of OpenCV.

    Raises:
        InputError: this OpenCV has neither.
    """
    for module in (cv2, getattr(cv2, "xfeatures2d", None)):
        if hasattr(module, name):
            return getattr(module, name)
    raise InputError(f"this OpenCV {cv2.__version__} has no {name}, the package opencv-contrib-python-headless has it")
