"""Structural similarity (SSIM) of kernels around manual or automatic points, over search areas that follow them.

After SSIMS of Ljubicic et al. (2021, section 2.1.2). The kernel of a point is its interrogation area in the reference.
Its SSIM at each displacement within the search area gives a score map. The position of the point is the maximum of the
map, refined by a Gaussian fitted to the scores around it. Maxima on the border of the map are rejected, because the
point may lie outside.

* "Areas follow": the search area is centred on the point's position under the predicted homography, rounded to whole
  pixels, so that the frame is never interpolated.
* "Kernel updating" for large rotations: the paper cuts new kernels from later frames, so errors accumulate. Here the
  kernel is resampled from the reference with the local affine part of the predicted homography, without accumulation.
* The score map of a kernel over its own surroundings is not exactly symmetric, because the contrast of the surroundings
  varies. The resulting bias of the peak is measured once, in the reference, and subtracted.
* "Expanding search": missing points are searched again in areas twice as large.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from stab_ros.core.errors import ConfigError
from stab_ros.core.settings import Checked, setting
from stab_ros.core.types import NO_POINTS, BoolArray, Correspondences, FloatArray, Gray, Homography, IdArray
from stab_ros.methods import _cramer_rao, _layout, _peaks
from stab_ros.methods._affine_windows import AffineMaps, sample
from stab_ros.methods._guided_matching import guided_matches
from stab_ros.methods._ssim_maps import ssim_maps

# Error terms besides the Cramer-Rao bound, calibrated on synthetic flights, so that chi-square per degree of freedom is
# about 1.
_EXCESS = 1.0
_PEAK_PX = 0.02


@dataclass(frozen=True)
class SsimConfig(Checked):
    """Parameters `ssim.*`."""

    points: int = setting(100, "Number of automatic points, if none are given", 4, 5000)
    layout: str = setting("even", _layout.LAYOUT_DOC, choices=_layout.LAYOUTS)
    area: int = setting(21, "Side of the kernel, odd, px", 5, 101)
    search: int = setting(41, "Side of the search area, odd, px", 7, 255)
    window: int = setting(7, "Side of the windows over which the similarity is averaged, px", 3, 101)
    subpixel: int = setting(3, "Side of the neighbourhood of the peak to which the Gaussian is fitted, odd, px", 3, 15)
    update_kernels: bool = setting(True, "Warp the kernels with the predicted motion")
    second_look: bool = setting(True, "Search missing points again at the positions predicted from the points found")
    expand: bool = setting(False, "Search missing points again in areas twice as large")
    min_score: float = setting(0.4, "Minimum similarity of a point", -1.0, 1.0)
    min_texture: float = setting(0.5, "Minimum mean squared gradient of a kernel, grey levels^2 per px^2", 0.01, 1e4)

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
        """Chooses the points and cuts their kernels.

        Args:
            reference: (h, w) uint8.
            allowed: (h, w) bool, where automatic points may lie.
            config: parameters.
            points_px: (n, 2), points given by the user, px; n = 0 for automatic ones. Points whose kernel is not
                completely inside the image are left out.
        """
        self._config, self._reference, area = config, reference, config.area
        centres = (_layout.user_points(points_px, area) if len(points_px) else
                   _layout.LAYOUT[config.layout](reference, allowed, config.points, area, area // 2 + 1,
                                                 config.min_texture))
        self.reference_px: FloatArray = centres[AffineMaps.identity(centres).inside(reference, area)]
        identity = AffineMaps.identity(self.reference_px)
        self._template = sample(reference, identity, area)
        self._structure = _cramer_rao.structure(self._template)
        nearest = sample(reference, identity, area + 2 * (config.subpixel // 2))
        self._bias_px = np.nan_to_num(_peaks.gaussian_fit(ssim_maps(self._template, nearest, config.window)))

    def match(self, current: Gray, guess: Homography, trust: FloatArray) -> Correspondences:
        def search(H: Homography, chosen: IdArray) -> Correspondences:
            return self._search(current, H, chosen)

        if not self._config.second_look:
            return search(guess, np.arange(len(self.reference_px)))
        return guided_matches(search, guess, self.reference_px, current.shape[::-1], trust)

    def _search(self, current: Gray, guess: Homography, chosen: IdArray) -> Correspondences:
        """Correspondences of those chosen points that are found around their positions under `guess`."""
        maps = AffineMaps.linearized(np.linalg.inv(guess), self.reference_px[chosen])
        if not self._config.update_kernels:
            maps = AffineMaps.identity(maps.centres)
        found_px = self._located(current, maps, self._config.search, chosen)
        lost = np.flatnonzero(np.isnan(found_px[:, 0]))
        if self._config.expand and len(lost):
            found_px[lost] = self._located(current, maps[lost], 2 * self._config.search - 1, chosen[lost])
        return self._verified(current, AffineMaps(found_px, maps.linear), chosen)

    def _located(self, current: Gray, maps: AffineMaps, search: int, chosen: IdArray) -> FloatArray:
        """Positions (n, 2), px, of the chosen points in the current frame; NaN where they are not found."""
        start = maps.rounded()
        scores = ssim_maps(self._kernels(maps, chosen), sample(current, start, search), self._config.window)
        peaks = _peaks.highest(scores)
        near = peaks.around(scores, self._config.subpixel)
        lag_px = np.stack([peaks.column, peaks.row], axis=1) - scores.shape[1] // 2
        bias_px = np.einsum("nij,nj->ni", maps.linear, self._bias_px[chosen])
        found_px = start.centres + lag_px + _peaks.gaussian_fit(near) - bias_px
        return np.where((peaks.height >= self._config.min_score)[:, None], found_px, np.nan)

    def _kernels(self, maps: AffineMaps, chosen: IdArray) -> FloatArray:
        """The chosen kernels (n, area, area), warped to the current frame."""
        if not self._config.update_kernels:
            return self._template[chosen]
        flat = np.abs(np.linalg.det(maps.linear)) < 1e-6
        shape = np.linalg.inv(np.where(flat[:, None, None], np.eye(2), maps.linear))
        return sample(self._reference, AffineMaps(self.reference_px[chosen], shape), self._config.area)

    def _verified(self, current: Gray, found: AffineMaps, chosen: IdArray) -> Correspondences:
        """Correspondences of the found points, with the information that follows from their correlation."""
        inside = found.inside(current, self._config.area)
        found, kept = found[inside], chosen[inside]
        template = self._template[kept]
        correlation = _cramer_rao.correlation(template, sample(current, found, self._config.area))
        peak_px = np.full(len(kept), _PEAK_PX)
        information = _cramer_rao.information(template, correlation, self._structure[kept], _EXCESS, peak_px)
        return Correspondences(kept, self.reference_px[kept], found.centres, information)
