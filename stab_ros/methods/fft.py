"""FFT cross-correlation of interrogation areas around manual or automatic points, in several passes.

After FFT-CUAS and FFT-DCH of Ljubicic et al. (2021, section 2.1.1), whose tools correlate with PIVlab (Thielicke and
Stamhuis 2014) and in MATLAB. Each pass correlates areas of the reference with areas of the same size in the current
frame (circular, by FFT, means subtracted). The range of a pass is half its area in theory and about a third in
practice. A pass measures 3x3 vectors on a grid around each point. The linear displacement field fitted to them shifts
and deforms the areas of the next pass. The last pass measures the point itself.

* The template is always cut from the reference, so errors do not accumulate. The text of FFT-DCH mentions the previous
  frame, but its program uses the first one; here the parameter `reference` decides.
* With `follow`, areas are placed and deformed by the predicted homography. Without it, they stay at the point's
  position in the reference.
* Before the peak is read, the correlation is divided by the overlap of the two areas at each lag (Westerweel 1997),
  because all displacements would be biased towards zero otherwise. The sub-pixel peak is a 2x3-point Gaussian fit.
* A point is not reported if its peak lies on the border of the correlation plane, if the second highest peak is nearly
  as high, or if the correlation of its area with the reference is too low.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from stab_ros.core.errors import ConfigError
from stab_ros.core.settings import Checked, setting
from stab_ros.core.text import counted
from stab_ros.core.types import NO_POINTS, BoolArray, Correspondences, FloatArray, Gray, Homography, IdArray
from stab_ros.methods import _cramer_rao, _layout, _peaks
from stab_ros.methods._affine_windows import AffineMaps, sample
from stab_ros.methods._guided_matching import guided_matches

_GRID = np.array([[x, y] for y in (-1, 0, 1) for x in (-1, 0, 1)])
_CENTRE = 4
_FIELD_VECTORS = 6  # of the 9; with fewer valid vectors, the areas are only translated
_MEDIAN_TEST, _MEDIAN_TEST_PX = 2.0, 0.1  # threshold and noise floor
_REACH_DIVISOR = 3  # later passes search the peak within this fraction of the area
# Error terms besides the Cramer-Rao bound: a constant of the sub-pixel peak, and a share of the last pass's correction
# (up to half a pixel). Calibrated on synthetic flights, so that chi-square per degree of freedom is about 1.
_EXCESS = 1.0
_PEAK_PX = 0.02
_LAST_SHIFT_SHARE, _MAX_SHIFT_PX = 0.15, 0.5
_SIDES = (8, 512)


@dataclass(frozen=True)
class FftConfig(Checked):
    """Parameters `fft.*`."""

    points: int = setting(100, "Number of automatic points, if none are given", 4, 5000)
    layout: str = setting("even", _layout.LAYOUT_DOC, choices=_layout.LAYOUTS)
    passes: str = setting("48,32,32", "Sides of the interrogation areas of successive passes, even numbers separated "
                                      "by commas, such as 32,16, px")
    steps: str = setting("", "Spacing of the 3x3 vectors, one value per pass (the last one is not used), such as "
                             "16,8; empty for half the areas, px")
    follow: bool = setting(True, "Move the interrogation areas with the predicted motion")
    second_look: bool = setting(True, "Search missing points again at the positions predicted from the points found")
    min_correlation: float = setting(0.5, "Minimum correlation of an area with the reference", 0.1, 0.99)
    min_peak_ratio: float = setting(1.0, "Minimum ratio of the highest to the second highest correlation peak",
                                    1.0, 10.0)
    min_texture: float = setting(0.5, "Minimum mean squared gradient of an area, grey levels^2 per px^2", 0.01, 1e4)

    def __post_init__(self) -> None:
        super().__post_init__()
        sides, steps = self.sides_px, self.steps_px
        if any(side % 2 or not _SIDES[0] <= side <= _SIDES[1] for side in sides):
            raise ConfigError(f"fft.passes: {self.passes!r}, the sides must be even numbers from "
                              f"{_SIDES[0]} to {_SIDES[1]}")
        if len(steps) != len(sides) or min(steps) < 1:
            raise ConfigError(f"fft.steps: {self.steps!r}, there must be one step of at least 1 px for each of the "
                              f"{counted(len(sides), 'pass', 'passes')}")

    @property
    def sides_px(self) -> tuple[int, ...]:
        return _whole_numbers("fft.passes", self.passes)

    @property
    def steps_px(self) -> tuple[int, ...]:
        return _whole_numbers("fft.steps", self.steps) if self.steps else tuple(side // 2 for side in self.sides_px)


def _whole_numbers(name: str, text: str) -> tuple[int, ...]:
    try:
        return tuple(int(part) for part in text.strip(" []").split(","))
    except ValueError as error:
        raise ConfigError(f"{name}: {text!r}, it must be whole numbers with commas between, as 32,16") from error


@dataclass(frozen=True, eq=False)
class CorrelationPass:
    """One pass: areas at k offsets from each of N points.

    Attributes:
        side: of an area, px.
        offsets: (k, 2), px.
        spectra: (N, k, side, side / 2 + 1) complex conjugate spectra of the areas of the reference.
        power: (N, k) sum of squares of each area; 0 where it is not completely inside the reference.
    """

    side: int
    offsets: FloatArray
    spectra: NDArray[np.complex128]
    power: FloatArray

    @staticmethod
    def of(reference: Gray, centres: FloatArray, side: int, offsets: FloatArray) -> CorrelationPass:
        areas = _mean_free_areas(reference, AffineMaps.identity(centres), side, offsets)
        inside = _inside(reference, AffineMaps.identity(centres), side, offsets)
        return CorrelationPass(side, offsets, np.conj(np.fft.rfft2(areas)), np.where(inside, _power(areas), 0.0))

    def correlate(self, current: Gray, maps: AffineMaps, chosen: IdArray) -> FloatArray:
        """Correlation planes (n, k, side, side), normalized, of the chosen points; lag 0 is at index side / 2."""
        areas = _mean_free_areas(current, maps, self.side, self.offsets)
        inside = _inside(current, maps, self.side, self.offsets)
        norm = np.sqrt(self.power[chosen] * np.where(inside, _power(areas), 0.0))
        plane = np.fft.irfft2(self.spectra[chosen] * np.fft.rfft2(areas), s=(self.side, self.side))
        scale = np.divide(1.0, norm, out=np.zeros_like(norm), where=norm > 0)
        return np.asarray(np.fft.fftshift(plane, axes=(2, 3)) * scale[:, :, None, None])


class Fft:
    """`stab_ros.methods.Method` by FFT cross-correlation."""

    Config: ClassVar[type[Any]] = FftConfig
    takes_points: ClassVar[bool] = True
    seeks_all: ClassVar[bool] = True

    def __init__(self, reference: Gray, allowed: BoolArray, config: FftConfig,
                 points_px: FloatArray = NO_POINTS) -> None:
        """Chooses the points and computes the spectra of their areas.

        In small images no area is wider than a third of the shorter side.

        Args:
            reference: (h, w) uint8.
            allowed: (h, w) bool, where automatic points may lie.
            config: parameters.
            points_px: (n, 2), points given by the user, px; n = 0 for automatic ones. Points whose largest area is not
                completely inside the image are left out.
        """
        self._config = config
        sides = tuple(min(side, _max_side_px(reference)) for side in config.sides_px)
        centres = self._choose_points(reference, allowed, points_px, max(sides), sides[-1])
        self.reference_px: FloatArray = centres[AffineMaps.identity(centres).inside(reference, max(sides))]
        offsets = [step * _GRID for step in config.steps_px[:-1]] + [np.zeros((1, 2))]
        self._passes = [CorrelationPass.of(reference, self.reference_px, side, at)
                        for side, at in zip(sides, offsets, strict=True)]
        self._template = sample(reference, AffineMaps.identity(self.reference_px), sides[-1])
        self._structure = _cramer_rao.structure(self._template)

    def _choose_points(self, reference: Gray, allowed: BoolArray, points_px: FloatArray, largest: int,
                last: int) -> FloatArray:
        config = self._config
        if len(points_px):
            return _layout.user_points(points_px, largest)
        return _layout.LAYOUT[config.layout](reference, allowed, config.points, last, largest // 2,
                                             config.min_texture)

    def match(self, current: Gray, guess: Homography, trust: FloatArray) -> Correspondences:
        def search(H: Homography, chosen: IdArray) -> Correspondences:
            return self._search(current, H, chosen)

        if not (self._config.second_look and self._config.follow):
            return search(guess, np.arange(len(self.reference_px)))
        return guided_matches(search, guess, self.reference_px, current.shape[::-1], trust)

    def _search(self, current: Gray, guess: Homography, chosen: IdArray) -> Correspondences:
        """Correspondences of those chosen points that are found around their positions under `guess`."""
        centres = self.reference_px[chosen]
        maps = (AffineMaps.linearized(np.linalg.inv(guess), centres) if self._config.follow else
                AffineMaps.identity(centres))
        found = np.ones(len(centres), bool)
        for number, one in enumerate(self._passes):
            reach = one.side // (2 if number == 0 else _REACH_DIVISOR)
            shift = self._peak_shifts(one.correlate(current, maps, chosen), reach)
            found &= np.isfinite(shift[:, len(one.offsets) // 2]).all(axis=1)
            displacement, gradient = _displacement_field(shift, one.offsets)
            maps = maps.displaced(displacement, gradient)
        usable = found & maps.inside(current, self._passes[-1].side)
        return self._verified(current, maps[usable], chosen[usable], np.hypot(*displacement[usable].T))

    def _peak_shifts(self, planes: FloatArray, reach: int) -> FloatArray:
        """Displacements (N, k, 2), px, of the peaks within `reach` of lag 0; NaN without a distinct peak."""
        n, k, side, _ = planes.shape
        low, high = side // 2 - reach, side // 2 + reach
        near = planes.reshape(n * k, side, side)[:, low:high, low:high]
        peaks = _peaks.highest(near)
        clear = peaks.height > 0
        if self._config.min_peak_ratio > 1:
            clear &= _peaks.ratio(near, peaks) >= self._config.min_peak_ratio
        lag_px = np.stack([peaks.column, peaks.row], axis=1) - reach
        middle = np.where(clear[:, None, None], peaks.around(near, 3) / _overlap(lag_px, side), np.nan)
        return np.asarray((lag_px + _peaks.gaussian_2x3(middle)).reshape(n, k, 2))

    def _verified(self, current: Gray, maps: AffineMaps, chosen: IdArray, last_shift_px: FloatArray) -> Correspondences:
        """Correspondences of those chosen points whose areas correlate with the reference."""
        correlation = _cramer_rao.correlation(self._template[chosen], sample(current, maps, self._passes[-1].side))
        good = correlation >= self._config.min_correlation
        kept, peak_px = chosen[good], np.hypot(_PEAK_PX, _LAST_SHIFT_SHARE * np.minimum(last_shift_px, _MAX_SHIFT_PX))
        information = _cramer_rao.information(self._template[kept], correlation[good], self._structure[kept], _EXCESS,
                                             peak_px[good])
        return Correspondences(kept, self.reference_px[kept], maps.centres[good], information)


def _max_side_px(gray: Gray) -> int:
    """Largest side of an area, px: an even third of the image's shorter side, but at least the smallest area."""
    return max(2 * (int(min(gray.shape)) // 6), _SIDES[0])


def _mean_free_areas(gray: Gray, maps: AffineMaps, side: int, offsets: FloatArray) -> FloatArray:
    """Areas (N, k, side, side) float64 at the offsets, with their means subtracted."""
    at = np.round(offsets).astype(np.int64)
    reach = int(np.abs(at).max(initial=0))
    wide = sample(gray, maps, side + 2 * reach)
    areas = np.stack([wide[:, reach + y : reach + y + side, reach + x : reach + x + side] for x, y in at], axis=1)
    return np.asarray(areas - areas.mean(axis=(2, 3), keepdims=True), np.float64)


def _inside(gray: Gray, maps: AffineMaps, side: int, offsets: FloatArray) -> BoolArray:
    """(N, k) bool: whether the areas lie completely inside the image."""
    places = maps.apply_to(offsets)
    return np.stack([dataclasses.replace(maps, centres=places[:, k]).inside(gray, side) for k in range(len(offsets))],
                    axis=1)


def _overlap(lag_px: IdArray, side: int) -> FloatArray:
    """Overlap (N, 3, 3) of two areas of `side` px, as a share, at the lags around each of (N, 2)."""
    x, y = (1 - np.abs(lag_px[:, axis, None] + np.arange(-1, 2)) / side for axis in (0, 1))
    return np.asarray(np.maximum(y[:, :, None] * x[:, None, :], 1 / side**2))


def _power(areas: FloatArray) -> FloatArray:
    return np.asarray(np.einsum("nkij,nkij->nk", areas, areas))


def _displacement_field(shift: FloatArray, offsets: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Displacement (N, 2), px, at each point and its gradient (N, 2, 2): a linear fit to vectors (N, k, 2) at offsets.

    With too few valid vectors it is the displacement of the point itself and a gradient of 0.
    """
    known = _median_test(shift)
    middle = np.nan_to_num(shift[:, len(offsets) // 2])
    enough = known.sum(axis=1) >= _FIELD_VECTORS
    design = np.column_stack([np.ones(len(offsets)), offsets])
    weight = np.where(enough[:, None], known, 0.0)
    normal = np.einsum("nk,ka,kb->nab", weight, design, design) + 1e-9 * np.eye(3)
    right = np.einsum("nk,ka,nkd->nad", weight, design, np.nan_to_num(shift))
    plane = np.linalg.solve(normal, right)
    return np.where(enough[:, None], plane[:, 0], middle), np.swapaxes(plane[:, 1:], 1, 2)


def _median_test(shift: FloatArray) -> BoolArray:
    """(N, k) bool: the vectors that pass the normalized median test (Westerweel and Scarano 2005)."""
    known: BoolArray = np.isfinite(shift.sum(axis=2))
    vectors = np.where(known[:, :, None], shift, np.nan)
    vectors[~known.any(axis=1)] = 0.0
    off = np.linalg.norm(vectors - np.nanmedian(vectors, axis=1)[:, None], axis=2)
    limit = _MEDIAN_TEST * (np.nanmedian(off, axis=1)[:, None] + _MEDIAN_TEST_PX)
    return np.asarray(known & (off <= limit))  # NaN compares false
