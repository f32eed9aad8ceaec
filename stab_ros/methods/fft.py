"""FFT cross-correlation of interrogation areas about manual or automatic points, in several passes.

After FFT-CUAS and FFT-DCH of Ljubicic et al. (2021, section 2.1.1), whose tools correlate with PIVlab (Thielicke and
Stamhuis 2014) and in MATLAB. Each pass correlates areas of the reference with areas of the same size in the current
frame (circular, by FFT, means subtracted), so a pass reaches half its area in theory and about a third in practice. It
does so at a grid of 3x3 vectors about each point, a step apart. The linear displacement field through them shifts and
deforms the areas of the next pass; the last pass measures the point itself.

* The reference is the template in every frame, so errors do not add up. FFT-DCH's text speaks of the previous frame;
  its program compares with the first one, and here `reference` decides.
* Areas that follow are where the predicted homography puts them, turned and stretched as it says. Areas that stay look
  where the point was in the reference.
* Before the peak is read, the correlation is divided by the share of the two areas that overlaps at each lag
  (Westerweel 1997), or all displacements would come out too small. The peak itself is the 2x3-point Gaussian's.
* Not reported are points whose peak lies on the border of the correlation plane, is not clear of the second highest
  peak, or whose area does not look like the reference where it was found.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from stab_ros.core.errors import ConfigError
from stab_ros.core.settings import Checked, setting
from stab_ros.core.types import NO_POINTS, BoolArray, Correspondences, FloatArray, Gray, Homography, IdArray
from stab_ros.methods import _agreement, _peaks, _places
from stab_ros.methods._areas import Maps, sample
from stab_ros.methods._second_look import looked_for_twice

_GRID = np.array([[x, y] for y in (-1, 0, 1) for x in (-1, 0, 1)])
_CENTRE = 4
_FIELD_VECTORS = 6  # of the 9: with fewer, the areas are only shifted
_MEDIAN_TEST, _MEDIAN_TEST_PX = 2.0, 0.1
_CLEAR_OF = 3  # later passes look for the peak within one over this of the area
# Errors of the points on the synthetic flights, beside the Cramer-Rao bound: those of the sub-pixel peak, and a share
# of the last pass's correction, as far as it is below half a pixel. So a chi-square per degree of freedom is about 1.
_EXCESS = 1.0
_PEAK_PX = 0.02
_OF_LAST_SHIFT, _MOST_SHIFT_PX = 0.15, 0.5
_SIDES = (8, 512)


@dataclass(frozen=True)
class FftConfig(Checked):
    """Parameters `fft.*`."""

    points: int = setting(100, "number of points, if none are given", 4, 5000)
    layout: str = setting("even", _places.LAYOUT_DOC, choices=_places.LAYOUTS)
    passes: str = setting("48,32,32", "sides of the areas of each pass, px, even numbers: 32,16")
    steps: str = setting("", "spacing of the 3x3 vectors of each pass but the last, px: 16,8; empty: half the areas")
    follow: bool = setting(True, "areas follow the predicted motion; else they stay")
    second_look: bool = setting(True, "points that are not found are looked for where the others say they are")
    min_correlation: float = setting(0.5, "an area that looks less like the reference is left out", 0.1, 0.99)
    min_peak_ratio: float = setting(1.0, "least ratio of the highest to the second highest peak", 1.0, 10.0)
    min_texture: float = setting(0.5, "least mean squared gradient of an area, grey levels^2 per px^2", 0.01, 1e4)

    def __post_init__(self) -> None:
        super().__post_init__()
        sides, steps = self.sides_px, self.steps_px
        if any(side % 2 or not _SIDES[0] <= side <= _SIDES[1] for side in sides):
            raise ConfigError(f"fft.passes: {self.passes!r}, the sides must be even numbers from "
                              f"{_SIDES[0]} to {_SIDES[1]}")
        if len(steps) != len(sides) or min(steps) < 1:
            raise ConfigError(f"fft.steps: {self.steps!r}, there must be one step of at least 1 px for each of the "
                              f"{len(sides)} passes")

    @property
    def sides_px(self) -> tuple[int, ...]:
        return _whole_numbers("fft.passes", self.passes)

    @property
    def steps_px(self) -> tuple[int, ...]:
        return _whole_numbers("fft.steps", self.steps) if self.steps else tuple(side // 2 for side in self.sides_px)


def _whole_numbers(name: str, text: str) -> tuple[int, ...]:
    try:
        return tuple(int(part) for part in text.split(","))
    except ValueError as error:
        raise ConfigError(f"{name}: {text!r}, it must be whole numbers with commas between, as 32,16") from error


@dataclass(frozen=True, eq=False)
class Pass:
    """One pass: areas of `side` px, at k offsets (k, 2) px from each of N points.

    spectra: (N, k, side, side / 2 + 1) complex, of the reference, conjugate. power: (N, k) sum of its squares; 0 where
    an area leaves the reference.
    """

    side: int
    offsets: FloatArray
    spectra: NDArray[np.complex128]
    power: FloatArray

    @staticmethod
    def of(reference: Gray, centres: FloatArray, side: int, offsets: FloatArray) -> Pass:
        areas = _cut(reference, Maps.standing(centres), side, offsets)
        inside = _inside(reference, Maps.standing(centres), side, offsets)
        return Pass(side, offsets, np.conj(np.fft.rfft2(areas)), np.where(inside, _power(areas), 0.0))

    def correlate(self, current: Gray, maps: Maps, chosen: IdArray) -> FloatArray:
        """(n, k, side, side) normalised correlation of the chosen points over all lags; zero lag is at side / 2."""
        areas = _cut(current, maps, self.side, self.offsets)
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
        """reference: (h, w) uint8. allowed: (h, w) bool, where points may be chosen. points_px: (n, 2), or none.

        Given points whose largest area does not fit into the picture are left out; in small pictures no area is wider
        than a third of the shorter side.
        """
        self._config = config
        sides = tuple(min(side, _largest_px(reference)) for side in config.sides_px)
        centres = self._places(reference, allowed, points_px, max(sides), sides[-1])
        self.reference_px: FloatArray = centres[Maps.standing(centres).inside(reference, max(sides))]
        offsets = [step * _GRID for step in config.steps_px[:-1]] + [np.zeros((1, 2))]
        self._passes = [Pass.of(reference, self.reference_px, side, at)
                        for side, at in zip(sides, offsets, strict=True)]
        self._template = sample(reference, Maps.standing(self.reference_px), sides[-1])
        self._structure = _agreement.structure(self._template)

    def _places(self, reference: Gray, allowed: BoolArray, points_px: FloatArray, largest: int,
                last: int) -> FloatArray:
        config = self._config
        if len(points_px):
            return _places.manual(points_px, largest)
        return _places.LAYOUT[config.layout](reference, allowed, config.points, last, largest // 2,
                                             config.min_texture)

    def match(self, current: Gray, guess: Homography, trust: FloatArray) -> Correspondences:
        def look(H: Homography, chosen: IdArray) -> Correspondences:
            return self._look(current, H, chosen)

        if not (self._config.second_look and self._config.follow):
            return look(guess, np.arange(len(self.reference_px)))
        return looked_for_twice(look, guess, self.reference_px, current.shape[::-1], trust)

    def _look(self, current: Gray, guess: Homography, chosen: IdArray) -> Correspondences:
        """Those of the chosen points that are found in the areas that `guess` moves."""
        centres = self.reference_px[chosen]
        maps = Maps.through(np.linalg.inv(guess), centres) if self._config.follow else Maps.standing(centres)
        found = np.ones(len(centres), bool)
        for number, one in enumerate(self._passes):
            shift = self._shifts(one.correlate(current, maps, chosen), one.side // (2 if number == 0 else _CLEAR_OF))
            found &= np.isfinite(shift[:, len(one.offsets) // 2]).all(axis=1)
            displacement, gradient = _field(shift, one.offsets)
            maps = maps.moved(displacement, gradient)
        sure = found & maps.inside(current, self._passes[-1].side)
        return self._judged(current, maps[sure], chosen[sure], np.hypot(*displacement[sure].T))

    def _shifts(self, planes: FloatArray, reach: int) -> FloatArray:
        """(N, k, 2) px: the peaks of correlation planes (N, k, s, s) within `reach`; NaN where not clear."""
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

    def _judged(self, current: Gray, maps: Maps, chosen: IdArray, last_shift_px: FloatArray) -> Correspondences:
        """Those of the chosen points that look like the reference where they were found."""
        alike = _agreement.correlation(self._template[chosen], sample(current, maps, self._passes[-1].side))
        good = alike >= self._config.min_correlation
        kept, peak_px = chosen[good], np.hypot(_PEAK_PX, _OF_LAST_SHIFT * np.minimum(last_shift_px, _MOST_SHIFT_PX))
        information = _agreement.information(self._template[kept], alike[good], self._structure[kept], _EXCESS,
                                             peak_px[good])
        return Correspondences(kept, self.reference_px[kept], maps.centres[good], information)


def _largest_px(gray: Gray) -> int:
    """An even third of the picture's shorter side, but no less than the smallest area."""
    return max(2 * (int(min(gray.shape)) // 6), _SIDES[0])


def _cut(gray: Gray, maps: Maps, side: int, offsets: FloatArray) -> FloatArray:
    """(N, k, side, side) float64: the areas at the offsets, about their means."""
    at = np.round(offsets).astype(np.int64)
    reach = int(np.abs(at).max(initial=0))
    wide = sample(gray, maps, side + 2 * reach)
    areas = np.stack([wide[:, reach + y : reach + y + side, reach + x : reach + x + side] for x, y in at], axis=1)
    return np.asarray(areas - areas.mean(axis=(2, 3), keepdims=True), np.float64)


def _inside(gray: Gray, maps: Maps, side: int, offsets: FloatArray) -> BoolArray:
    """(N, k) bool: the areas lie wholly in the picture."""
    places = maps.at(offsets)
    return np.stack([dataclasses.replace(maps, centres=places[:, k]).inside(gray, side) for k in range(len(offsets))],
                    axis=1)


def _overlap(lag_px: IdArray, side: int) -> FloatArray:
    """(N, 3, 3) share of two areas of `side` px that overlaps, at the lags about each of (N, 2)."""
    x, y = (1 - np.abs(lag_px[:, axis, None] + np.arange(-1, 2)) / side for axis in (0, 1))
    return np.asarray(np.maximum(y[:, :, None] * x[:, None, :], 1 / side**2))


def _power(areas: FloatArray) -> FloatArray:
    return np.asarray(np.einsum("nkij,nkij->nk", areas, areas))


def _field(shift: FloatArray, offsets: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Displacement (N, 2) px at the point and its gradient (N, 2, 2), from vectors (N, k, 2) at offsets (k, 2).

    Where too few of the vectors are known and agree, that of the point itself, and no gradient.
    """
    known = _agreeing(shift)
    middle = np.nan_to_num(shift[:, len(offsets) // 2])
    enough = known.sum(axis=1) >= _FIELD_VECTORS
    design = np.column_stack([np.ones(len(offsets)), offsets])
    weight = np.where(enough[:, None], known, 0.0)
    normal = np.einsum("nk,ka,kb->nab", weight, design, design) + 1e-9 * np.eye(3)
    right = np.einsum("nk,ka,nkd->nad", weight, design, np.nan_to_num(shift))
    plane = np.linalg.solve(normal, right)
    return np.where(enough[:, None], plane[:, 0], middle), np.swapaxes(plane[:, 1:], 1, 2)


def _agreeing(shift: FloatArray) -> BoolArray:
    """(N, k) bool: the known vectors that are not off by the normalised median test (Westerweel and Scarano 2005)."""
    known: BoolArray = np.isfinite(shift.sum(axis=2))
    vectors = np.where(known[:, :, None], shift, np.nan)
    vectors[~known.any(axis=1)] = 0.0
    off = np.linalg.norm(vectors - np.nanmedian(vectors, axis=1)[:, None], axis=2)
    limit = _MEDIAN_TEST * (np.nanmedian(off, axis=1)[:, None] + _MEDIAN_TEST_PX)
    return np.asarray(known & (off <= limit))  # NaN compares false
