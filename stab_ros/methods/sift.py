"""SIFT: extrema of differences of Gaussians, described by histograms of gradients (Lowe 2004).

What Zhang et al. 2023 stabilise satellite video with (section 2.1, Eq. 1 to 4), in OpenCV's implementation with Lowe's
values. The picture is searched in tiles, the strongest key points of each: spread evenly, and at any resolution with
the memory of one tile.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, ClassVar

import cv2
import numpy as np

from stab_ros.core.settings import Checked, setting
from stab_ros.core.types import NO_POINTS, BoolArray, FloatArray, Gray
from stab_ros.methods._descriptors import DescriptorMethod, Features, Rule, within

_TILE_PX = 480
_MARGIN_PX = 48  # of a tile, beyond its share of the picture: larger key points are not looked for
_OFFSET_PX = 0.25  # OpenCV doubles the picture and forgets that its pixel centres have moved
# Of a place along either axis, measured against the truth of synthetic flights: 0.08 px, and 1 % of a large one's size.
_SIGMA_PX, _SIGMA_SHARE = 0.06, 0.008


@dataclass(frozen=True)
class SiftConfig(Checked):
    """Parameters `sift.*`."""

    features: int = setting(5000, "most key points of a picture, spread evenly", 16, 50000)
    ratio: float = setting(0.8, "a match is nearer than this times the second nearest descriptor", 0.1, 1.0)
    contrast: float = setting(0.04, "least contrast of a key point, Lowe's scale", 0.0, 1.0)
    edge: float = setting(10.0, "largest ratio of curvatures: along an edge a place is uncertain", 1.0, 100.0)
    layers: int = setting(3, "scales an octave", 1, 8)
    sigma: float = setting(1.6, "blur of the first scale, px", 0.5, 5.0)


class Sift(DescriptorMethod):
    """`stab_ros.methods.Method` by SIFT."""

    Config: ClassVar[type[Any]] = SiftConfig

    def __init__(self, reference: Gray, allowed: BoolArray, config: SiftConfig,
                 points_px: FloatArray = NO_POINTS) -> None:
        """reference: (h, w) uint8. allowed: (h, w) bool, where key points may lie. It takes no `points_px`."""
        self._config = config
        super().__init__(within(self._found(reference), allowed), self._found, Rule(config.ratio))

    def _found(self, gray: Gray) -> Features:
        found = [self._of_tile(gray, *span) for span in _tiles(gray.shape)]
        return Features(*(np.concatenate(parts) for parts in zip(*found, strict=True)))

    def _of_tile(self, gray: Gray, rows: tuple[int, int], columns: tuple[int, int]
                 ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Places, their sigma and descriptors of the key points within `rows` and `columns`."""
        top, left = max(0, rows[0] - _MARGIN_PX), max(0, columns[0] - _MARGIN_PX)
        tile = np.ascontiguousarray(gray[top : rows[1] + _MARGIN_PX, left : columns[1] + _MARGIN_PX])
        points, descriptor = self._detector(tile.size / gray.size).detectAndCompute(tile, None)
        if not points:
            return np.empty((0, 2)), np.empty(0), np.empty((0, 128), np.float32)
        px = np.array([point.pt for point in points]) - _OFFSET_PX + (left, top)
        size = np.array([point.size for point in points])
        within = ((px >= (columns[0] - 0.5, rows[0] - 0.5)) & (px < (columns[1] - 0.5, rows[1] - 0.5))).all(axis=1)
        keep = within & (size < _MARGIN_PX)
        return px[keep], np.hypot(_SIGMA_PX, _SIGMA_SHARE * size[keep]), descriptor[keep]

    def _detector(self, share: float) -> cv2.SIFT:
        """For a tile that is this share of the picture."""
        config = self._config
        return cv2.SIFT.create(nfeatures=max(1, round(config.features * share)), nOctaveLayers=config.layers,
                               contrastThreshold=config.contrast, edgeThreshold=config.edge, sigma=config.sigma)


def _tiles(shape: tuple[int, ...]) -> Iterator[tuple[tuple[int, int], tuple[int, int]]]:
    """Rows and columns [from, to) of the tiles that cover a picture."""
    spans = [np.linspace(0, n, max(1, round(n / _TILE_PX)) + 1).astype(int).tolist() for n in shape]
    for rows in zip(spans[0], spans[0][1:], strict=False):
        for columns in zip(spans[1], spans[1][1:], strict=False):
            yield rows, columns
