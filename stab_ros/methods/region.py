"""Planar tracking of a few markers: template search, then the turn and size of each marker.

After the tracker of Blender (Ljubicic et al. 2021, section 2.1.4), whose paper is silent about how it works; the steps
are those of its library libmv, written anew:

1. The pattern of a marker, cut from the reference, is looked for at every whole px of the search area, by the sum of
   absolute differences, turned and stretched as the predicted homography says.
2. From the best place, translation, rotation and scale of the marker (`motion`) are refined until nothing moves, on
   pictures blurred a little, both brought to the same mean and contrast.
3. A marker whose correlation with its pattern is too low is lost.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import cv2
import numpy as np

from stab_ros.core.errors import ConfigError
from stab_ros.core.settings import Checked, setting
from stab_ros.core.types import NO_POINTS, BoolArray, Correspondences, FloatArray, Gray, Homography, IdArray, Image
from stab_ros.methods import _agreement, _places, _planar
from stab_ros.methods._areas import Maps, sample
from stab_ros.methods._second_look import looked_for_twice

# Errors of the markers on the synthetic flights, beside the Cramer-Rao bound: so the chi-square per degree of freedom
# is about 1. Blurred residuals are alike from pixel to pixel, which is most of the excess.
_EXCESS = 4.0
_FLOOR_PX = 0.01


@dataclass(frozen=True)
class RegionConfig(Checked):
    """Parameters `region.*`."""

    points: int = setting(100, "number of markers, if none are given", 4, 5000)
    area: int = setting(21, "side of the pattern, px, odd", 7, 101)
    search: int = setting(41, "side of the search area, px, odd", 7, 255)
    motion: str = setting("translation_rotation_scale", "how a marker may move", choices=tuple(_planar.MOTIONS))
    blur: float = setting(0.9, "standard deviation of the blur of both pictures, px; 0: none", 0.0, 10.0)
    iterations: int = setting(20, "at most, of the refinement", 1, 200)
    second_look: bool = setting(True, "markers that are not found are looked for where the others say they are")
    min_correlation: float = setting(0.75, "a marker that looks less like its pattern is lost", 0.1, 0.99)
    layout: str = setting("even", _places.LAYOUT_DOC, choices=_places.LAYOUTS)
    min_distance: float = setting(0.0, "between automatic markers, px: the strongest Harris corners; 0: spread evenly",
                                  0.0, 5000.0)
    margin: int = setting(0, "at the picture's border, px, that automatic markers keep clear of", 0, 5000)
    min_texture: float = setting(0.5, "least mean squared gradient of a pattern, grey levels^2 per px^2", 0.01, 1e4)

    def __post_init__(self) -> None:
        super().__post_init__()
        for name, side in (("area", self.area), ("search", self.search)):
            if side % 2 == 0:
                raise ConfigError(f"region.{name}: {side} is even, it must be odd")
        if self.search < self.area:
            raise ConfigError(f"region.search: {self.search} px, it must be at least the area, {self.area} px")


class Region:
    """`stab_ros.methods.Method` by planar markers."""

    Config: ClassVar[type[Any]] = RegionConfig
    takes_points: ClassVar[bool] = True
    seeks_all: ClassVar[bool] = True

    def __init__(self, reference: Gray, allowed: BoolArray, config: RegionConfig,
                 points_px: FloatArray = NO_POINTS) -> None:
        """reference: (h, w) uint8. allowed: (h, w) bool, where markers may be chosen. points_px: (n, 2), or none.

        Given points whose pattern does not fit into the picture are left out.
        """
        self._config = config
        centres = _places.manual(points_px, config.area) if len(points_px) else self._places(reference, allowed)
        self.reference_px: FloatArray = centres[Maps.standing(centres).inside(reference, config.area + 2)]
        standing = Maps.standing(self.reference_px)
        self._pattern = sample(reference, standing, config.area)
        self._blurred = sample(self._blur(reference), standing, config.area + 2)

    def _places(self, reference: Gray, allowed: BoolArray) -> FloatArray:
        config = self._config
        margin = max(config.margin, config.area // 2 + 1)
        if config.min_distance > 0:
            return _places.apart(reference, allowed, config.points, config.area, margin, config.min_distance)
        return _places.LAYOUT[config.layout](reference, allowed, config.points, config.area, margin,
                                             config.min_texture)

    def _blur(self, gray: Gray) -> Image:
        """float32."""
        values = gray.astype(np.float32)
        return np.asarray(cv2.GaussianBlur(values, (0, 0), self._config.blur)) if self._config.blur > 0 else values

    def match(self, current: Gray, guess: Homography, trust: FloatArray) -> Correspondences:
        blurred = self._blur(current)

        def look(H: Homography, chosen: IdArray) -> Correspondences:
            return self._look(current, blurred, H, chosen)

        if not self._config.second_look:
            return look(guess, np.arange(len(self.reference_px)))
        return looked_for_twice(look, guess, self.reference_px, current.shape[::-1], trust)

    def _look(self, current: Gray, blurred: Image, guess: Homography, chosen: IdArray) -> Correspondences:
        """Those of the chosen markers that are found in the search areas that `guess` moves."""
        maps = Maps.through(np.linalg.inv(guess), self.reference_px[chosen])
        areas = sample(current, maps, self._config.search)
        lag_px, clear = _planar.best_place(self._pattern[chosen], areas)
        start = maps.moved(lag_px, np.zeros((len(chosen), 2, 2)))
        found = _planar.refine(blurred, self._blurred[chosen], start, self._config.motion, self._config.iterations)
        near = np.abs(found.maps.centres - start.centres).max(axis=1, initial=0.0) <= self._config.area / 4
        good = clear & near & (found.correlation >= self._config.min_correlation)
        return self._pairs(chosen[good], found.maps.centres[good], found.correlation[good], found.structure[good])

    def _pairs(self, kept: IdArray, current_px: FloatArray, alike: FloatArray,
               structure: FloatArray) -> Correspondences:
        template = self._blurred[kept, 1:-1, 1:-1]
        floor_px = np.full(len(kept), _FLOOR_PX)
        information = _agreement.information(template, alike, structure, _EXCESS, floor_px)
        return Correspondences(kept, self.reference_px[kept], current_px, information)
