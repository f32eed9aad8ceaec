"""From RMSD to displacement: the polynomial of Ljubicic et al. (2021), Eq. 3, fitted at a point of the reference."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from stab_ros.core.types import FloatArray, Gray, IdArray
from stab_ros.metrics._shift_response import SHIFTS_PX, Sweep

FIT_TO_PX = 5.0  # the paper: a second-degree polynomial fits up to 4 to 5 px
_FADING_FROM_PX, _FADING = 4.25, 0.8  # by so much a px less count the last shifts, where it fits worst
_UNSURE_PX = 0.02  # a shift as short as that does not tell its direction
_FEWEST = 3  # shifts to fit, however soon RMSD stops rising
_FLAT = 0.01  # RMSD, grey levels
_PLATEAU = 0.95  # of the largest RMSD: beyond, the curve is too flat to read a displacement from it
_TOLERABLE_SHARE, _TOLERABLE_PX = 0.15, 0.05  # of a displacement, whichever is more: what the fit may be off by


@dataclass(frozen=True)
class Calibration:
    """Eq. 3 at one point: d = a RMSD^2 + b RMSD, px, with RMSD in grey levels; a, b >= 0, so d never falls.

    by_direction: a and b of Eq. 3 for shifts at 0, 45, 90 and 135 degrees alone; empty: a and b for all directions.
    r2: coefficient of determination over all shifts and directions up to `FIT_TO_PX`. range_px: the largest
    displacement that can be told; beyond, RMSD hardly rises any more, or falls. window_px: N of the windows it holds
    for. range_rmsd: the RMSD that a displacement by `range_px` makes.

    Raises:
        ValueError: coefficients or a range of no rising polynomial.
    """

    a: float
    b: float
    r2: float
    range_px: float
    window_px: int
    range_rmsd: float = math.inf
    by_direction: tuple[tuple[float, float], ...] = ()

    def __post_init__(self) -> None:
        if not (self.a >= 0 and self.b >= 0 and self.a + self.b > 0 and self.range_px > 0):
            raise ValueError(f"a = {self.a}, b = {self.b}, range {self.range_px} px: they must not be negative, "
                             "and not all 0")

    def displacement_px(self, rmsd: FloatArray | float) -> FloatArray:
        """Same shape as `rmsd` (grey levels): the displacement, px, never above `range_px`; NaN stays NaN."""
        return np.minimum(self._polynomial(rmsd), self.range_px)

    def beyond(self, rmsd: FloatArray | float) -> Any:
        """Same shape as `rmsd`, bool: it is larger than a displacement within `range_px` makes it."""
        return (self._polynomial(rmsd) > self.range_px) | (np.asarray(rmsd) > self.range_rmsd)

    def displacement_towards_px(self, rmsd: float, moved_px: FloatArray) -> float:
        """As `displacement_px`, for a window whose content moved about in the direction of `moved_px` (2,), x then y.

        Where that is not known (0, NaN), as there.
        """
        in_any = float(self.displacement_px(rmsd))
        length_px = float(np.hypot(*moved_px))
        along_px = np.array([a * rmsd * rmsd + b * rmsd for a, b in self.by_direction])
        if not (len(along_px) and in_any > 0 and length_px > 0 and (along_px > 0).all()):  # NaN compares false
            return in_any
        sure = length_px**2 / (length_px**2 + _UNSURE_PX**2)
        return min(_at_angle(along_px, math.atan2(moved_px[1], moved_px[0]), sure), self.range_px)

    def _polynomial(self, rmsd: FloatArray | float) -> FloatArray:
        values = np.asarray(rmsd, np.float64)
        return np.asarray(self.a * values * values + self.b * values)


def _at_angle(along_px: FloatArray, angle: float, sure: float) -> float:
    """Between the displacements (4,) along 0, 45, 90 and 135 degrees that make one RMSD; `sure` 0: their mean.

    RMSD^2 is d^2 times a quadratic form of the direction (the structure tensor), so 1 / d^2 varies with 2 `angle`.
    """
    s0, s45, s90, s135 = s = 1 / along_px**2
    varying = ((s0 - s90) / 2 * math.cos(2 * angle) + (s45 - s135) / 2 * math.sin(2 * angle)
               + (s0 - s45 + s90 - s135) / 4 * math.cos(4 * angle))
    return float(np.clip(s.mean() + sure * varying, s.min(), s.max()) ** -0.5)


@dataclass(frozen=True, eq=False)
class Curve:
    """What was fitted: the RMSD (M,), grey levels, that shifts by `shift_px` (M,) make, mean over the directions."""

    shift_px: FloatArray
    rmsd: FloatArray

    @property
    def strength(self) -> float:
        """The RMSD that a displacement of 1 px makes, grey levels."""
        return float(np.interp(1.0, self.shift_px, self.rmsd))


def calibrate(reference: Gray, centre_px: Sequence[int] | IdArray, window_px: int,
              noise_sigma: float) -> tuple[Calibration, Curve]:
    """Eq. 3 for the window of `window_px` (odd) about `centre_px` (x, y) of `reference` (h, w) uint8.

    noise_sigma: of the reference, grey levels. Beyond the picture's border it is taken to be mirrored.

    Raises:
        ValueError: an even window, one that leaves the picture, or one without any texture.
    """
    half = window_px // 2
    x, y = (int(c) for c in centre_px)
    height, width = reference.shape
    if window_px % 2 == 0 or not (half <= x < width - half and half <= y < height - half):
        raise ValueError(f"the window of {window_px} px about ({x}, {y}) must be odd and inside {width}x{height} px")
    return fitted(Sweep(reference, noise_sigma).rmsd((x, y), [window_px])[0], window_px)


def fitted(rmsd: FloatArray, window_px: int) -> tuple[Calibration, Curve]:
    """Calibration and curve from `rmsd` (shifts, directions) of a `Sweep`.

    Raises:
        ValueError: a shift changes nothing.
    """
    curve = Curve(SHIFTS_PX, rmsd.mean(axis=1))
    end = _end_of_rise(curve.rmsd)
    if is_flat(rmsd):
        raise ValueError("a window without texture: a shift changes nothing in it")
    used = max(_FEWEST, min(end, int(np.searchsorted(SHIFTS_PX, FIT_TO_PX))) + 1)
    a, b = (float(c) for c in coefficients(SHIFTS_PX[:used], curve.rmsd[:used]))
    half = rmsd.shape[1] // 2  # opposite directions make nearly the same RMSD
    of_directions = coefficients(SHIFTS_PX[:used], (rmsd[:used, :half] + rmsd[:used, half:]) / 2)
    by_direction = tuple((float(one), float(other)) for one, other in zip(*of_directions, strict=True))
    r2 = float(determination(a, b, np.repeat(SHIFTS_PX[:used], rmsd.shape[1]), rmsd[:used].ravel()))
    return Calibration(a, b, r2, float(SHIFTS_PX[end]), window_px, float(curve.rmsd[end]), by_direction), curve


def is_flat(rmsd: FloatArray) -> bool:
    """Whether shifts change nothing but the rounding of the arithmetic: there is nothing to calibrate."""
    return bool(rmsd.max() < _FLAT)


def coefficients(shift_px: FloatArray, rmsd: FloatArray) -> tuple[FloatArray, FloatArray]:
    """A and b of Eq. 3, neither negative, for RMSD (S, ...) of shifts by `shift_px` (S,); (...) each, 0 for no RMSD.

    Least squares in which a misfit counts by what is tolerable at that displacement, so that small ones are right too.
    """
    d = shift_px.reshape(-1, *[1] * (rmsd.ndim - 1))
    fading = np.clip(1 - _FADING * (d - _FADING_FROM_PX), 0, 1)
    weight = fading / np.maximum(_TOLERABLE_SHARE * d, _TOLERABLE_PX) ** 2
    m2, m3, m4 = (np.sum(weight * rmsd**n, axis=0) for n in (2, 3, 4))
    d1, d2 = (np.sum(weight * d * rmsd**n, axis=0) for n in (1, 2))
    determinant = m4 * m2 - m3 * m3
    a = _ratio(d2 * m2 - d1 * m3, determinant)
    b = _ratio(d1 * m4 - d2 * m3, determinant)
    a, b = np.where(b < 0, _ratio(d2, m4), a), np.where(a < 0, _ratio(d1, m2), b)
    return np.maximum(a, 0), np.maximum(b, 0)


def determination(a: FloatArray | float, b: FloatArray | float, shift_px: FloatArray, rmsd: FloatArray) -> FloatArray:
    """(...) R^2 of Eq. 3 with a and b (...) for RMSD (S, ...) of shifts by `shift_px` (S,)."""
    d = shift_px.reshape(-1, *[1] * (rmsd.ndim - 1))
    misfit = np.sum((d - a * rmsd**2 - b * rmsd) ** 2, axis=0)
    return np.asarray(1 - misfit / np.sum((d - d.mean()) ** 2))


def _ratio(above: FloatArray, below: FloatArray) -> FloatArray:
    """0 where both are."""
    return np.asarray(above / np.where(below > 0, below, np.inf))


def _end_of_rise(rmsd: FloatArray) -> int:
    """Index of the last shift up to which RMSD rises, and by enough to be read."""
    falls = np.flatnonzero(np.diff(rmsd) <= 0)
    highest = int(falls[0]) if len(falls) else len(rmsd) - 1
    return int(np.flatnonzero(rmsd >= _PLATEAU * rmsd[highest])[0])
