"""What the methods by descriptors share: key points of two pictures, and which of them are the same place.

Matches are each other's nearest descriptor, clearly nearer than the second (Lowe 2004, section 7.1), and one a place:
a key point with two orientations has two descriptors, but is one measurement. Nothing here depends on the guess, so a
camera that has jumped or turned is found again as easily as one that stands.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar, TypeAlias

import cv2
import numpy as np

from stab_ros.core.errors import InputError
from stab_ros.core.types import BoolArray, Correspondences, FloatArray, Gray, Homography, IdArray, Image

_CELLS = 4  # key points in a cell of the grid over which they are spread, if they were spread evenly


@dataclass(frozen=True, eq=False)
class Features:
    """Key points of one picture.

    px: (N, 2) float64, centres of pixels are whole numbers. sigma_px: (N,), of a place, along either axis.
    descriptor: (N, k), float32 or uint8 (bits).
    """

    px: FloatArray
    sigma_px: FloatArray
    descriptor: Image

    def __len__(self) -> int:
        return len(self.px)

    def __getitem__(self, keep: BoolArray | IdArray) -> Features:
        return Features(self.px[keep], self.sigma_px[keep], self.descriptor[keep])


Find: TypeAlias = Callable[[Gray], Features]


@dataclass(frozen=True)
class Rule:
    """When two descriptors match: nearest to second nearest below `ratio`, both ways, and no further than `most`."""

    ratio: float
    norm: int = cv2.NORM_L2
    most: float = float("inf")


class Remembered:
    """A `Find` that looks at the same picture only once: a frame may be matched from several guesses."""

    def __init__(self, find: Find) -> None:
        self._find = find
        self._last: tuple[Gray, Features] | None = None

    def __call__(self, gray: Gray) -> Features:
        if self._last is None or not np.array_equal(self._last[0], gray):
            self._last = gray.copy(), self._find(gray)
        return self._last[1]


class DescriptorMethod:
    """`stab_ros.methods.Method` by any detector and descriptor; a place is a feature."""

    takes_points: ClassVar[bool] = False  # it chooses its features itself
    seeks_all: ClassVar[bool] = False

    def __init__(self, features: Features, find: Find, rule: Rule) -> None:
        """features: of the reference. find: finds those of a frame."""
        self._features, self._find, self._rule = features, Remembered(find), rule
        self.reference_px: FloatArray
        self.reference_px, place = np.unique(features.px, axis=0, return_inverse=True)
        self._place = place.reshape(-1)

    def match(self, current: Gray, guess: Homography, trust: FloatArray) -> Correspondences:
        now = self._find(current)
        one, other = matched(self._features, now, self._rule)
        feature_id = self._place[one]
        variance = self._features.sigma_px[one] ** 2 + now.sigma_px[other] ** 2
        information = np.eye(2) / variance[:, None, None]
        return Correspondences(feature_id, self.reference_px[feature_id], now.px[other], information)


def within(features: Features, allowed: BoolArray) -> Features:
    """Those that lie where `allowed`, (h, w) bool."""
    column, row = np.round(features.px).astype(np.int64).T
    return features[allowed[row, column]]


def matched(ones: Features, others: Features, rule: Rule) -> tuple[IdArray, IdArray]:
    """Indices (n,) into both of what matches by `rule`, one match a place, the nearest descriptors first."""
    nothing = np.empty(0, np.int64), np.empty(0, np.int64)
    if not len(ones) or not len(others):
        return nothing
    there, distance, clear = _nearest(ones.descriptor, others.descriptor, rule)
    one = np.flatnonzero(clear)
    if not len(one):
        return nothing
    back, _, back_clear = _nearest(others.descriptor[there[one]], ones.descriptor, rule)
    one = one[back_clear & (back == one)]
    one = one[np.argsort(distance[one], kind="stable")]
    once = _first_of_places(ones.px[one])
    once = once[_first_of_places(others.px[there[one[once]]])]
    return one[once], there[one[once]]


def _nearest(ones: Image, others: Image, rule: Rule) -> tuple[IdArray, FloatArray, BoolArray]:
    """Of each: its nearest among the others, how far that is, and whether it is clearly the nearest."""
    kind = cv2.CV_32S if rule.norm == cv2.NORM_HAMMING else cv2.CV_32F
    distance, index = cv2.batchDistance(ones, others, kind, None, None, rule.norm, min(2, len(others)))
    best = distance[:, 0].astype(np.float64)
    second = distance[:, 1] if len(others) > 1 else np.full(len(ones), np.inf)
    return index[:, 0].astype(np.int64), best, (best <= rule.most) & (best < rule.ratio * second)


def _first_of_places(px: FloatArray) -> IdArray:
    """Indices, ascending, of the first feature at each place."""
    return np.asarray(np.sort(np.unique(px, axis=0, return_index=True)[1]))


def spread(px: FloatArray, response: FloatArray, count: int, shape: tuple[int, ...]) -> IdArray:
    """At most `count` of the points: of each cell of an even grid the strongest, then the second strongest, ...

    px: (N, 2). response: (N,). shape: of the picture. Returns indices, ascending.
    """
    if len(px) <= count:
        return np.arange(len(px))
    side = max(1.0, float(np.sqrt(_CELLS * shape[0] * shape[1] / count)))
    column, row = np.floor(np.maximum(px, 0) / side).astype(np.int64).T
    cell = row * (int(shape[1] / side) + 2) + column
    order = np.lexsort((-response, cell))
    starts = np.flatnonzero(np.diff(cell[order], prepend=-1))
    rank = np.arange(len(px)) - np.repeat(starts, np.diff(starts, append=len(px)))
    best = np.lexsort((-response[order], rank))[:count]
    return np.asarray(np.sort(order[best]))


def contrib(name: str) -> Any:
    """`cv2.<name>` or `cv2.xfeatures2d.<name>`, wherever this version of OpenCV keeps it.

    Raises:
        InputError: it has none.
    """
    for module in (cv2, getattr(cv2, "xfeatures2d", None)):
        if hasattr(module, name):
            return getattr(module, name)
    raise InputError(f"this OpenCV {cv2.__version__} has no {name}, the package opencv-contrib-python-headless has it")
