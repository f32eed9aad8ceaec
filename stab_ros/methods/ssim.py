"""Structural similarity (SSIM) of kernels about manual or automatic points, over search areas that follow them.

After SSIMS of Ljubicic et al. (2021, section 2.1.2). The kernel of a point is its interrogation area in the reference;
its SSIM with each equal part of the search area makes a score map, whose maximum, refined by the Gaussian fitted to the
scores about it, is where the point is. Maxima on the border of the map are not reported: the point may be beyond.

* "Areas follow": the search area is centred where the predicted homography puts the point, on whole pixels, so that
  the frame is never interpolated.
* "Kernel updating" for large rotation: the paper cuts new kernels from later frames, at the cost of errors that add
  up. Here the kernel is rendered from the reference, turned and stretched as the predicted homography does there, so
  that it looks as it should in the current frame, and nothing adds up.
* The peak of a kernel's score map over its own surroundings does not lie exactly on itself, since the parts it is
  compared with differ in contrast from side to side. What it misses is measured once, in the reference, and taken off.
* "Expanding search": points that are not found are looked for again in search areas twice as large.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from stab_ros.core.errors import ConfigError
from stab_ros.core.settings import Checked, setting
from stab_ros.core.types import NO_POINTS, BoolArray, Correspondences, FloatArray, Gray, Homography, IdArray
from stab_ros.methods import _agreement, _peaks, _places
from stab_ros.methods._areas import Maps, sample
from stab_ros.methods._second_look import looked_for_twice
from stab_ros.methods._similarity import ssim_maps

# Errors of the points on the synthetic flights, beside the Cramer-Rao bound: so the chi-square per degree of freedom
# is about 1.
_EXCESS = 1.0
_PEAK_PX = 0.02


@dataclass(frozen=True)
class SsimConfig(Checked):
    """Parameters `ssim.*`."""

    points: int = setting(100, "number of points, if none are given", 4, 5000)
    layout: str = setting("even", _places.LAYOUT_DOC, choices=_places.LAYOUTS)
    area: int = setting(21, "side of the kernel, px, odd", 5, 101)
    search: int = setting(41, "side of the search area, px, odd", 7, 255)
    window: int = setting(7, "side of the windows whose similarity is averaged, px", 3, 101)
    subpixel: int = setting(3, "side of the part of the score map the Gaussian is fitted to, odd", 3, 15)
    update_kernels: bool = setting(True, "kernels are turned and stretched as the predicted motion says")
    second_look: bool = setting(True, "points that are not found are looked for where the others say they are")
    expand: bool = setting(False, "points that are not found are looked for in twice the search area")
    min_score: float = setting(0.4, "a point with a lower similarity is left out", -1.0, 1.0)
    min_texture: float = setting(0.5, "least mean squared gradient of a kernel, grey levels^2 per px^2", 0.01, 1e4)

    def __post_init__(self) -> None:
        super().__post_init__()
        for name, side in (("area", self.area), ("search", self.search), ("subpixel", self.subpixel)):
            if side % 2 == 0:
                raise ConfigError(f"ssim.{name}: {side} is even, it must be odd")
        if self.search < self.area + self.subpixel - 1:
            raise ConfigError(f"ssim.search: {self.search} px, it must be at least {self.area + self.subpixel - 1} px "
                              f"for an area of {self.area} and a sub-pixel fit of {self.subpixel} px")


class Ssim:
    """`stab_ros.methods.Method` by structural similarity."""

    Config: ClassVar[type[Any]] = SsimConfig
    takes_points: ClassVar[bool] = True
    seeks_all: ClassVar[bool] = True

    def __init__(self, reference: Gray, allowed: BoolArray, config: SsimConfig,
                 points_px: FloatArray = NO_POINTS) -> None:
        """reference: (h, w) uint8. allowed: (h, w) bool, where points may be chosen. points_px: (n, 2), or none.

        Given points whose kernel does not fit into the picture are left out.
        """
        self._config, self._reference, area = config, reference, config.area
        centres = (_places.manual(points_px, area) if len(points_px) else
                   _places.LAYOUT[config.layout](reference, allowed, config.points, area, area // 2 + 1,
                                                 config.min_texture))
        self.reference_px: FloatArray = centres[Maps.standing(centres).inside(reference, area)]
        standing = Maps.standing(self.reference_px)
        self._template = sample(reference, standing, area)
        self._structure = _agreement.structure(self._template)
        nearest = sample(reference, standing, area + 2 * (config.subpixel // 2))
        self._miss_px = np.nan_to_num(_peaks.gaussian_fit(ssim_maps(self._template, nearest, config.window)))

    def match(self, current: Gray, guess: Homography, trust: FloatArray) -> Correspondences:
        def look(H: Homography, chosen: IdArray) -> Correspondences:
            return self._look(current, H, chosen)

        if not self._config.second_look:
            return look(guess, np.arange(len(self.reference_px)))
        return looked_for_twice(look, guess, self.reference_px, current.shape[::-1], trust)

    def _look(self, current: Gray, guess: Homography, chosen: IdArray) -> Correspondences:
        """Those of the chosen points that are found in the search areas that `guess` moves."""
        maps = Maps.through(np.linalg.inv(guess), self.reference_px[chosen])
        if not self._config.update_kernels:
            maps = Maps.standing(maps.centres)
        found_px = self._located(current, maps, self._config.search, chosen)
        lost = np.flatnonzero(np.isnan(found_px[:, 0]))
        if self._config.expand and len(lost):
            found_px[lost] = self._located(current, maps[lost], 2 * self._config.search - 1, chosen[lost])
        return self._judged(current, Maps(found_px, maps.shape), chosen)

    def _located(self, current: Gray, maps: Maps, search: int, chosen: IdArray) -> FloatArray:
        """(n, 2) px: where the chosen points are in the current frame; NaN where they are not found."""
        start = maps.whole_pixels()
        scores = ssim_maps(self._kernels(maps, chosen), sample(current, start, search), self._config.window)
        peaks = _peaks.highest(scores)
        near = peaks.around(scores, self._config.subpixel)
        lag_px = np.stack([peaks.column, peaks.row], axis=1) - scores.shape[1] // 2
        miss_px = np.einsum("nij,nj->ni", maps.shape, self._miss_px[chosen])
        found_px = start.centres + lag_px + _peaks.gaussian_fit(near) - miss_px
        return np.where((peaks.height >= self._config.min_score)[:, None], found_px, np.nan)

    def _kernels(self, maps: Maps, chosen: IdArray) -> FloatArray:
        """(n, area, area) the chosen kernels as they should look in the current frame."""
        if not self._config.update_kernels:
            return self._template[chosen]
        flat = np.abs(np.linalg.det(maps.shape)) < 1e-6
        shape = np.linalg.inv(np.where(flat[:, None, None], np.eye(2), maps.shape))
        return sample(self._reference, Maps(self.reference_px[chosen], shape), self._config.area)

    def _judged(self, current: Gray, found: Maps, chosen: IdArray) -> Correspondences:
        """What was found of the chosen points, with the information its likeness to the reference leaves it."""
        inside = found.inside(current, self._config.area)
        found, kept = found[inside], chosen[inside]
        template = self._template[kept]
        alike = _agreement.correlation(template, sample(current, found, self._config.area))
        peak_px = np.full(len(kept), _PEAK_PX)
        information = _agreement.information(template, alike, self._structure[kept], _EXCESS, peak_px)
        return Correspondences(kept, self.reference_px[kept], found.centres, information)
