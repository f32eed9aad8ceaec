"""Planar tracking of markers: exhaustive template search, then refinement of each marker's motion model.

After the tracker of Blender (Ljubicic et al. 2021, section 2.1.4). The paper does not describe its algorithm; the steps
are those of Blender's library libmv, reimplemented:

1. The pattern of a marker is cut from the reference and compared at each whole pixel of the search area, by the sum of
   absolute differences. The search area is resampled with the local affine part of the predicted homography.
2. From the best position, the marker's motion model (`motion`) is refined until convergence, on slightly blurred images
   that are normalized to the same mean and contrast.
3. A marker whose correlation with its pattern is too low is dropped.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import cv2
import numpy as np

from stab_ros.core.errors import ConfigError
from stab_ros.core.settings import Checked, setting
from stab_ros.core.types import NO_POINTS, BoolArray, Correspondences, FloatArray, Gray, Homography, IdArray, Image
from stab_ros.methods import _cramer_rao, _layout, _planar
from stab_ros.methods._affine_windows import AffineMaps, sample
from stab_ros.methods._guided_matching import guided_matches

# Error terms besides the Cramer-Rao bound, calibrated on synthetic flights, so that chi-square per degree of freedom is
# about 1. Most of the excess comes from the correlation of blurred residuals between pixels.
_EXCESS = 4.0
_FLOOR_PX = 0.01


@dataclass(frozen=True)
class RegionConfig(Checked):
    """Parameters `region.*`."""

    points: int = setting(100, "Number of automatic markers, if none are given", 4, 5000)
    area: int = setting(21, "Side of the pattern, odd, px", 7, 101)
    search: int = setting(41, "Side of the search area, odd, px", 7, 255)
    motion: str = setting("translation_rotation_scale", "Motion model of a marker", choices=tuple(_planar.MOTIONS))
    blur: float = setting(0.9, "Standard deviation of the Gaussian blur of both images; 0 for no blur, px", 0.0, 10.0)
    iterations: int = setting(20, "Maximum number of iterations of the refinement", 1, 200)
    second_look: bool = setting(True, "Search missing markers again at the positions predicted from the markers found")
    min_correlation: float = setting(0.75, "Minimum correlation of a marker with its pattern", 0.1, 0.99)
    layout: str = setting("even", _layout.LAYOUT_DOC, choices=_layout.LAYOUTS)
    min_distance: float = setting(0.0, "Minimum distance of automatic markers, which are then the strongest Harris "
                                       "corners; 0 to use `layout`, px", 0.0, 5000.0)
    margin: int = setting(0, "Minimum distance of automatic markers from the image border, px", 0, 5000)
    min_texture: float = setting(0.5, "Minimum mean squared gradient of a pattern, grey levels^2 per px^2", 0.01, 1e4)

    def __post_init__(self) -> None:
        super().__post_init__()
        for name, side in (("area", self.area), ("search", self.search)):
            if side % 2 == 0:
                raise ConfigError(f"region.{name}: {side} is even, it must be odd")
        if self.search < self.area:
            raise ConfigError(f"region.search: {self.search} px, it must be at least the area, {self.area} px")


class RegionMethod:
    """`stab_ros.methods.Method` by planar markers."""

    Config: ClassVar[type[Any]] = RegionConfig
    takes_points: ClassVar[bool] = True
    seeks_all: ClassVar[bool] = True

    def __init__(self, reference: Gray, allowed: BoolArray, config: RegionConfig,
                 points_px: FloatArray = NO_POINTS) -> None:
        """Chooses the markers and cuts their patterns.

        Args:
            reference: (h, w) uint8.
            allowed: (h, w) bool, where automatic markers may lie.
            config: parameters.
            points_px: (n, 2), markers given by the user, px; n = 0 for automatic ones. Markers whose pattern is not
                completely inside the image are left out.
        """
        self._config = config
        centres = (_layout.user_points(points_px, config.area) if len(points_px) else
                   self._choose_points(reference, allowed))
        self.reference_px: FloatArray = centres[AffineMaps.identity(centres).inside(reference, config.area + 2)]
        identity = AffineMaps.identity(self.reference_px)
        self._pattern = sample(reference, identity, config.area)
        self._blurred = sample(self._blur(reference), identity, config.area + 2)

    def _choose_points(self, reference: Gray, allowed: BoolArray) -> FloatArray:
        config = self._config
        margin = max(config.margin, config.area // 2 + 1)
        if config.min_distance > 0:
            return _layout.strongest_corners(reference, allowed, config.points, config.area, margin,
                                             config.min_distance)
        return _layout.LAYOUT[config.layout](reference, allowed, config.points, config.area, margin,
                                             config.min_texture)

    def _blur(self, gray: Gray) -> Image:
        """The image, (h, w) float32, blurred by `config.blur`."""
        values = gray.astype(np.float32)
        return np.asarray(cv2.GaussianBlur(values, (0, 0), self._config.blur)) if self._config.blur > 0 else values

    def match(self, current: Gray, guess: Homography, trust: FloatArray) -> Correspondences:
        blurred = self._blur(current)

        def search(H: Homography, chosen: IdArray) -> Correspondences:
            return self._search(current, blurred, H, chosen)

        if not self._config.second_look:
            return search(guess, np.arange(len(self.reference_px)))
        return guided_matches(search, guess, self.reference_px, current.shape[::-1], trust)

    def _search(self, current: Gray, blurred: Image, guess: Homography, chosen: IdArray) -> Correspondences:
        """Correspondences of those chosen markers that are found around their positions under `guess`."""
        maps = AffineMaps.linearized(np.linalg.inv(guess), self.reference_px[chosen])
        areas = sample(current, maps, self._config.search)
        lag_px, clear = _planar.best_lag(self._pattern[chosen], areas)
        start = maps.displaced(lag_px, np.zeros((len(chosen), 2, 2)))
        found = _planar.refine(blurred, self._blurred[chosen], start, self._config.motion, self._config.iterations)
        near = np.abs(found.maps.centres - start.centres).max(axis=1, initial=0.0) <= self._config.area / 4
        good = clear & near & (found.correlation >= self._config.min_correlation)
        return self._pairs(chosen[good], found.maps.centres[good], found.correlation[good], found.structure[good])

    def _pairs(self, kept: IdArray, current_px: FloatArray, correlation: FloatArray,
               structure: FloatArray) -> Correspondences:
        template = self._blurred[kept, 1:-1, 1:-1]
        floor_px = np.full(len(kept), _FLOOR_PX)
        information = _cramer_rao.information(template, correlation, structure, _EXCESS, floor_px)
        return Correspondences(kept, self.reference_px[kept], current_px, information)
