"""SIFT: extrema of differences of Gaussians, described by histograms of gradients (Lowe 2004).

Zhang et al. (2023, section 2.1, eq. 1 to 4) stabilize satellite video with it. OpenCV's implementation with Lowe's
parameters. The image is searched in tiles, and the strongest key points of each tile are kept: they are spread evenly,
and the memory needed is that of one tile at any resolution.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, ClassVar

import cv2
import numpy as np

from stab_ros.core.settings import Checked, setting
from stab_ros.core.types import NO_POINTS, BoolArray, FloatArray, Gray
from stab_ros.methods._descriptors import DescriptorMethod, Features, MatchRule, within

_TILE_PX = 480
_MARGIN_PX = 48  # overlap of a tile with its neighbours; larger key points are not detected
_OFFSET_PX = 0.25  # bias of OpenCV's SIFT, which ignores that upsampling moves the pixel centres
# Standard deviation of a position along either axis: a constant, and a share of the key point's size. Calibrated
# against ground truth of synthetic flights: 0.08 px, and 1 % of the size of large key points.
_SIGMA_PX, _SIGMA_SHARE = 0.06, 0.008


@dataclass(frozen=True)
class SiftConfig(Checked):
    """Parameters `sift.*`."""

    features: int = setting(5000, "Maximum number of key points per image, spread evenly", 16, 50000)
    ratio: float = setting(0.8, "Ratio test: maximum ratio of the nearest to the second nearest descriptor distance",
                           0.1, 1.0)
    contrast: float = setting(0.04, "Contrast threshold of a key point, on Lowe's scale", 0.0, 1.0)
    edge: float = setting(10.0, "Edge threshold: maximum ratio of the principal curvatures", 1.0, 100.0)
    layers: int = setting(3, "Number of scales per octave", 1, 8)
    sigma: float = setting(1.6, "Standard deviation of the Gaussian of the first scale, px", 0.5, 5.0)


class Sift(DescriptorMethod):
    """`stab_ros.methods.Method` by SIFT."""

    Config: ClassVar[type[Any]] = SiftConfig

    def __init__(self, reference: Gray, allowed: BoolArray, config: SiftConfig,
                 points_px: FloatArray = NO_POINTS) -> None:
        """Detects the key points of the reference.

        Args:
            reference: (h, w) uint8.
            allowed: (h, w) bool, where key points may lie.
            config: parameters.
            points_px: not used.
        """
        self._config = config
        super().__init__(within(self._detect(reference), allowed), self._detect, MatchRule(config.ratio))

    def _detect(self, gray: Gray) -> Features:
        found = [self._detect_tile(gray, *span) for span in _tiles(gray.shape)]
        return Features(*(np.concatenate(parts) for parts in zip(*found, strict=True)))

    def _detect_tile(self, gray: Gray, rows: tuple[int, int], columns: tuple[int, int]
                 ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Positions, their standard deviations and descriptors of the key points within `rows` and `columns`."""
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
        """A detector for a tile that covers this share of the image."""
        config = self._config
        return cv2.SIFT.create(nfeatures=max(1, round(config.features * share)), nOctaveLayers=config.layers,
                               contrastThreshold=config.contrast, edgeThreshold=config.edge, sigma=config.sigma)


def _tiles(shape: tuple[int, ...]) -> Iterator[tuple[tuple[int, int], tuple[int, int]]]:
    """Rows and columns [from, to) of the tiles that cover an image of `shape`."""
    spans = [np.linspace(0, n, max(1, round(n / _TILE_PX)) + 1).astype(int).tolist() for n in shape]
    for rows in zip(spans[0], spans[0][1:], strict=False):
        for columns in zip(spans[1], spans[1][1:], strict=False):
            yield rows, columns
