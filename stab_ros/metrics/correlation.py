"""Displacements of interrogation areas by FFT cross-correlation, as in particle image velocimetry (PIV).

After PIVlab (Thielicke and Stamhuis 2014), which Ljubicic et al. (2021, section 2.5.1) use: several passes with window
offset, and a Gaussian peak fit. Two things differ. The image is not interpolated between passes; instead the window
function moves by the fraction of a pixel, so that both windows contain the same content at any displacement. And the
spectra are band-passed, which down-weights slow changes of illumination and the finest detail that interpolation and
sensor distort.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from stab_ros.core.types import BoolArray, FloatArray, Gray, IdArray
from stab_ros.metrics.window_spectra import (
    LOW_PASS_PX,
    band_pass,
    both_halves,
    correlation_at,
    gaussian_peak,
    taper,
    window_spectra,
)

MARGIN_PX = 8  # distance of areas from the border, so that their content may move outwards
_SMALLEST_PX = 16
_MIN_TEXTURE = 0.2  # (grey levels/px)^2, mean square gradient in the weaker direction; twice that of 2 levels of noise
_MIN_CORRELATION = 0.6  # moving water is below, a few frames later
_MIN_FIRST_CORRELATION = 0.2  # in the first pass, where the windows overlap only partly
_MIN_PEAK_RATIO = 1.3
_PEAK_RADIUS_PX = 5  # exclusion radius for the second peak
_PASSES = 4  # largest number after the first
_LAST_STEP_PX = 0.02  # convergence; the remaining error is about a twentieth of the last step
_CHUNK = 64  # areas processed at once, which limits the memory
_LAGS = np.arange(-1, 2)


class Correlator:
    """Measures the displacements of n square areas of a reference in other images.

    Attributes:
        shape: (h, w) of the reference.
        areas_px: (n, 2) int64, centres; areas near the border are moved inwards.
        window_px: side of the areas; smaller than requested if the image is too small.
    """

    def __init__(self, reference: Gray, centres_px: IdArray, window_px: int = 64) -> None:
        """Computes the spectra of the areas.

        Args:
            reference: (h, w) uint8.
            centres_px: (n, 2), x and y.
            window_px: side of the areas, even, at least 16.

        Raises:
            ValueError: wrong shape, dtype or window.
        """
        _check(reference, centres_px, window_px)
        size = np.array(reference.shape[::-1])
        self.shape = reference.shape
        self.window_px = min(window_px, (int(size.min()) - 2 * MARGIN_PX) // 2 * 2)
        reach = self.window_px // 2 + MARGIN_PX
        self.areas_px = np.clip(np.asarray(centres_px, np.int64), reach, np.maximum(size - reach, reach))
        self._areas = _Areas(reference, self.areas_px, self.window_px) if self.window_px >= _SMALLEST_PX else None
        self._search = _Search(reference, self.areas_px, self.window_px // 16) if self._areas else None

    def shifts(self, current: Gray, usable: BoolArray | None = None, valid: BoolArray | None = None) -> FloatArray:
        """Displacements (n, 2) float64, u and v in px, of the reference's content in `current`.

        NaN where there is no distinct peak: too little texture, low correlation, or a second peak nearly as high.

        Args:
            current: (h, w) uint8.
            usable: (n,) bool, areas to measure; None for all.
            valid: (h, w) bool, valid part of `current`; areas that are not completely inside, at their old or new
                position, get NaN.

        Raises:
            ValueError: `current` or `valid` differs in shape from the reference.
        """
        if current.shape != self.shape or (valid is not None and valid.shape != self.shape):
            raise ValueError(f"an image of {current.shape}, with {None if valid is None else valid.shape} valid, "
                             f"it must be {self.shape} as the reference")
        found = np.full(self.areas_px.shape, np.nan)
        if self._areas is None or self._search is None:
            return found
        wanted = self._areas.textured if usable is None else self._areas.textured & usable
        at = np.flatnonzero(wanted)
        if valid is not None:
            at = at[self._areas.inside(valid, at, np.zeros((len(at), 2)))]
        found[at] = _search_shifts(self._areas, current, at, np.zeros((len(at), 2)))
        lost = at[np.isnan(found[at, 0])]
        if len(lost):
            found[lost] = _search_shifts(self._areas, current, lost, self._search.shifts(current, lost))
        if valid is not None:
            found[at[~self._areas.inside(valid, at, found[at])]] = np.nan
        return found


def _check(reference: Gray, centres_px: IdArray, window_px: int) -> None:
    if reference.ndim != 2 or reference.dtype != np.uint8:
        raise ValueError(f"a reference of {reference.shape} {reference.dtype}, it must be (h, w) uint8")
    if np.ndim(centres_px) != 2 or np.shape(centres_px)[1] != 2:
        raise ValueError(f"centres of {np.shape(centres_px)}, they must be (n, 2)")
    if window_px < _SMALLEST_PX or window_px % 2:
        raise ValueError(f"interrogation areas of {window_px} px, they must be even and at least {_SMALLEST_PX}")


class _Areas:
    """Band-passed spectra of the areas in the reference, and their correlation with an image."""

    def __init__(self, reference: Gray, centres_px: IdArray, window_px: int) -> None:
        self._corners_px, self._window_px = centres_px - window_px // 2, window_px
        self._room_px = np.array(reference.shape[::-1]) - window_px
        self._band = band_pass(window_px)
        still = np.zeros(centres_px.shape)
        spectra = window_spectra(self._cut(reference, self._corners_px), still)
        self._energy = self._energies(spectra)
        self._template = np.conj(spectra) * self._band
        smooth = cv2.GaussianBlur(np.asarray(reference, np.float32), (0, 0), LOW_PASS_PX)
        slopes = [self._cut(cv2.Sobel(smooth, cv2.CV_32F, *axis, ksize=1, scale=0.5), self._corners_px)
                  for axis in ((1, 0), (0, 1))]
        self.textured = _weaker_texture(*slopes) >= _MIN_TEXTURE

    def inside(self, mask: BoolArray, at: IdArray, shift_px: FloatArray) -> BoolArray:
        """(m,) bool: whether the areas `at` (m,), moved by `shift_px` (m, 2), lie completely where `mask` is True."""
        inside = self.fit(at, shift_px)
        corners = self._corners_px[at[inside]] + np.round(shift_px[inside]).astype(np.int64)
        inside[inside] = self._cut(mask, corners).all(axis=(1, 2))
        return inside

    def fit(self, at: IdArray, shift_px: FloatArray) -> BoolArray:
        """(m,) bool: whether `shift_px` is finite and the areas `at`, moved by it, lie inside the image."""
        corners = self._corners_px[at] + np.round(shift_px)  # NaN compares false
        return np.asarray(np.all((corners >= 0) & (corners <= self._room_px), axis=1))

    def plane(self, current: Gray, at: IdArray, offset_px: FloatArray) -> FloatArray:
        """Correlation planes (m, N, N), normalized, of the areas `at` (m,) over all lags around integer `offset_px`."""
        cross, scale = self._cross(current, at, offset_px)
        side = self._window_px
        lags = np.fft.irfft2(cross, s=(side, side)) * (side**2 * scale)[:, None, None]
        return np.asarray(np.fft.fftshift(lags, axes=(1, 2)))

    def around(self, current: Gray, at: IdArray, shift_px: FloatArray) -> FloatArray:
        """Correlation (m, 3, 3) at the lags -1, 0 and 1 px around `shift_px`, which may be fractional."""
        cross, scale = self._cross(current, at, shift_px)
        lags_px = (shift_px - np.round(shift_px))[:, :, None] + _LAGS
        return np.asarray(correlation_at(cross, lags_px) * scale[:, None, None])

    def _cross(self, current: Gray, at: IdArray, shift_px: FloatArray) -> tuple[NDArray[np.complex128], FloatArray]:
        """Cross spectra (m, N, N/2+1), and the factors (m,) that normalize their sum to a correlation coefficient."""
        offset = np.round(shift_px)
        patches = self._cut(current, self._corners_px[at] + offset.astype(np.int64))
        spectra = window_spectra(patches, shift_px - offset)
        power = self._energy[at] * self._energies(spectra)
        scale = np.divide(1.0, np.sqrt(power), out=np.zeros(len(at)), where=power > 0)
        spectra *= self._template[at]
        return spectra, scale

    def _energies(self, spectra: NDArray[np.complex128]) -> FloatArray:
        power = spectra.real**2 + spectra.imag**2
        return np.asarray(np.einsum("nij,ij->n", power, self._band * both_halves(self._window_px)))

    def _cut(self, image: NDArray[Any], corners_px: IdArray) -> NDArray[Any]:
        side = self._window_px
        return np.asarray(sliding_window_view(image, (side, side))[corners_px[:, 1], corners_px[:, 0]])


class _Search:
    """Coarse search for areas with a large displacement: templates twice as wide, on images reduced by `factor`."""

    _REACH, _RADIUS = 16, 16  # of the search and of the template, px of the reduced image

    def __init__(self, reference: Gray, centres_px: IdArray, factor: int) -> None:
        self._factor, self._centres_px = factor, centres_px // factor
        self._size_px = np.array(reference.shape[::-1]) // factor
        self._reference = reference

    def shifts(self, current: Gray, at: IdArray) -> FloatArray:
        """Displacements (m, 2), px, of the areas `at` (m,), accurate to about `factor` px; NaN without a match."""
        return np.array([self._shift(current, self._centres_px[i]) for i in at])

    def _shift(self, current: Gray, centre_px: IdArray) -> FloatArray:
        low, high = np.maximum(centre_px - self._RADIUS, 0), np.minimum(centre_px + self._RADIUS, self._size_px)
        first, last = np.maximum(low - self._REACH, 0), np.minimum(high + self._REACH, self._size_px)
        left, top = (self._REACH - (low - first)).tolist()  # padding, since part of the content may leave the image
        right, bottom = (self._REACH - (last - high)).tolist()
        ground = cv2.copyMakeBorder(self._shrunk(current, first, last), top, bottom, left, right, cv2.BORDER_REPLICATE)
        match = cv2.matchTemplate(ground, self._shrunk(self._reference, low, high), cv2.TM_CCOEFF_NORMED)
        _, best, _, place = cv2.minMaxLoc(match)
        shift = (np.array(place) - self._REACH) * float(self._factor)
        return shift if best >= _MIN_CORRELATION else np.full(2, np.nan)

    def _shrunk(self, gray: Gray, low: IdArray, high: IdArray) -> Gray:
        """The part from `low` to `high` (x, y) of the image reduced by block averages."""
        (left, top), (right, bottom) = self._factor * low, self._factor * high
        size = tuple((high - low).tolist())
        return np.asarray(cv2.resize(gray[top:bottom, left:right], size, interpolation=cv2.INTER_AREA))


def _weaker_texture(slope_x: FloatArray, slope_y: FloatArray) -> FloatArray:
    """Smaller eigenvalue (n,) of the structure tensor of each area (n, N, N) (Shi and Tomasi 1994).

    The displacement along an edge or stripes cannot be measured (aperture problem), although the ends of the window
    cause a peak.
    """
    weights = taper(slope_x.shape[1], np.zeros(1))[0] ** 2
    weights /= weights.sum()
    xx, yy, xy = (weights @ product @ weights for product in (slope_x**2, slope_y**2, slope_x * slope_y))
    return np.asarray((xx + yy) / 2 - np.hypot((xx - yy) / 2, xy))


def _search_shifts(areas: _Areas, current: Gray, at: IdArray, start_px: FloatArray) -> FloatArray:
    """Displacements (m, 2) of the areas `at` within a quarter of the window of `start_px` (m, 2)."""
    chunks = range(0, len(at), _CHUNK)
    found = [_refine_shifts(areas, current, at[i : i + _CHUNK], start_px[i : i + _CHUNK]) for i in chunks]
    return np.concatenate(found) if found else np.empty((0, 2))


def _refine_shifts(areas: _Areas, current: Gray, at: IdArray, start_px: FloatArray) -> FloatArray:
    """As `_search_shifts`: the highest peak of the correlation plane, then iterative sub-pixel refinement."""
    shift, done = np.full(start_px.shape, np.nan), np.zeros(len(at), bool)
    k = np.flatnonzero(areas.fit(at, start_px))
    start = np.round(start_px[k])
    shift[k] = start + _highest_peak(areas.plane(current, at[k], start))
    for _ in range(_PASSES):
        k = np.flatnonzero(~done & areas.fit(at, shift))
        if not len(k):
            break
        near = areas.around(current, at[k], shift[k])
        step = gaussian_peak(near)
        alike = near[:, 1, 1] >= _MIN_CORRELATION
        shift[k] = np.where(alike[:, None], shift[k] + step, np.nan)
        done[k] = alike & np.all(np.abs(step) <= _LAST_STEP_PX, axis=1)
    return np.where(done[:, None], shift, np.nan)


def _highest_peak(plane: FloatArray) -> FloatArray:
    """Lag (m, 2), px, of the highest peak of each plane (m, N, N); NaN where it is not distinct."""
    middle, reach = plane.shape[1] // 2, plane.shape[1] // 4
    near = plane[:, middle - reach : middle + reach + 1, middle - reach : middle + reach + 1]
    each, lags = np.arange(len(near)), np.arange(-reach, reach + 1)
    y, x = np.divmod(near.reshape(len(near), len(lags) ** 2).argmax(axis=1), len(lags)) - np.array([[reach], [reach]])
    dx, dy = lags - x[:, None], lags - y[:, None]
    away = (dx**2)[:, None, :] + (dy**2)[:, :, None] > _PEAK_RADIUS_PX**2
    first, second = plane[each, middle + y, middle + x], np.where(away, near, 0.0).max(axis=(1, 2))
    clear = (first >= _MIN_FIRST_CORRELATION) & (first >= _MIN_PEAK_RATIO * second)
    rows, columns = (middle + y[:, None] + _LAGS)[:, :, None], (middle + x[:, None] + _LAGS)[:, None, :]
    peak = np.stack([x, y], axis=1) + gaussian_peak(plane[each[:, None, None], rows, columns])
    return np.where(clear[:, None], peak, np.nan)
