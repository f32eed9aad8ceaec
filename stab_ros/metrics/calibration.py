"""From RMSD to displacement: the polynomial d(RMSD) of Ljubicic et al. (2021), Eq. 3, fitted at a point."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from stab_ros.core.types import FloatArray
from stab_ros.metrics._shift_response import SHIFTS_PX

FIT_TO_PX = 5.0  # according to the paper, a second-degree polynomial fits up to 4 to 5 px
_FADE_START_PX, _FADE_PER_PX = 4.25, 0.8  # the weight of larger shifts, where the fit is worst, decreases
_DIRECTION_NOISE_PX = 0.02  # error of a measured displacement, which makes the direction of a small one uncertain
_MIN_SHIFTS = 3  # in the fit, even if RMSD stops rising earlier
_FLAT = 0.01  # RMSD, grey levels
_PLATEAU = 0.95  # of the largest RMSD; above, the curve is too flat to determine a displacement
_TOLERANCE_SHARE, _TOLERANCE_PX = 0.15, 0.05  # accepted error of the fit: share of the displacement, or px if larger


@dataclass(frozen=True)
class Calibration:
    """Eq. 3 at one point: d = a RMSD^2 + b RMSD, px, with RMSD in grey levels.

    Attributes:
        a, b: coefficients, not negative, so that d increases with RMSD.
        r2: coefficient of determination over all shifts and directions up to `FIT_TO_PX`.
        range_px: largest measurable displacement; beyond it, RMSD hardly rises, or falls.
        window_px: N of the windows.
        range_rmsd: RMSD of a displacement by `range_px`, grey levels.
        by_direction: a and b for shifts at 0, 45, 90 and 135 degrees; empty if the same for all directions.

    Raises:
        ValueError: coefficients or a range that do not define an increasing polynomial.
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
        """Displacement, px, for `rmsd` (any shape, grey levels), at most `range_px`; NaN for NaN."""
        return np.minimum(self._polynomial(rmsd), self.range_px)

    def beyond(self, rmsd: FloatArray | float) -> Any:
        """Bool, of the shape of `rmsd`: whether it is larger than for a displacement by `range_px`."""
        return (self._polynomial(rmsd) > self.range_px) | (np.asarray(rmsd) > self.range_rmsd)

    def displacement_towards_px(self, rmsd: float, moved_px: FloatArray) -> float:
        """As `displacement_px`, for a displacement in the direction of `moved_px` (2,), x and y, if that is known.

        rmsd: grey levels. moved_px: 0 or NaN if not known.
        """
        isotropic_px = float(self.displacement_px(rmsd))
        length_px = float(np.hypot(*moved_px))
        axis_px = np.array([a * rmsd * rmsd + b * rmsd for a, b in self.by_direction])
        if not (len(axis_px) and isotropic_px > 0 and length_px > 0 and (axis_px > 0).all()):  # NaN compares false
            return isotropic_px
        certainty = length_px**2 / (length_px**2 + _DIRECTION_NOISE_PX**2)
        return min(_displacement_at_angle(axis_px, math.atan2(moved_px[1], moved_px[0]), certainty), self.range_px)

    def _polynomial(self, rmsd: FloatArray | float) -> FloatArray:
        values = np.asarray(rmsd, np.float64)
        return np.asarray(self.a * values * values + self.b * values)


def _displacement_at_angle(axis_px: FloatArray, angle: float, certainty: float) -> float:
    """Displacement in the direction `angle`, rad, from those (4,) along 0, 45, 90 and 135 degrees with the same RMSD.

    RMSD^2 is d^2 times a quadratic form of the direction (the structure tensor), so 1 / d^2 varies with 2 `angle`. It
    tends to the mean over the directions as `certainty` tends to 0.
    """
    s0, s45, s90, s135 = s = 1 / axis_px**2
    varying = ((s0 - s90) / 2 * math.cos(2 * angle) + (s45 - s135) / 2 * math.sin(2 * angle)
               + (s0 - s45 + s90 - s135) / 4 * math.cos(4 * angle))
    return float(np.clip(s.mean() + certainty * varying, s.min(), s.max()) ** -0.5)


@dataclass(frozen=True, eq=False)
class Curve:
    """The calibration curve: RMSD (M,), grey levels, mean over the directions, for shifts by `shift_px` (M,)."""

    shift_px: FloatArray
    rmsd: FloatArray

    @property
    def strength(self) -> float:
        """RMSD of a displacement by 1 px, grey levels."""
        return float(np.interp(1.0, self.shift_px, self.rmsd))



def fit_calibration(rmsd: FloatArray, window_px: int) -> tuple[Calibration, Curve]:
    """Calibration and curve from the RMSD (shifts, directions), grey levels, of a `ShiftResponse`.

    Raises:
        ValueError: a window without texture.
    """
    curve = Curve(SHIFTS_PX, rmsd.mean(axis=1))
    end = _last_rising(curve.rmsd)
    if is_flat(rmsd):
        raise ValueError("a window without texture: a shift changes nothing in it")
    used = max(_MIN_SHIFTS, min(end, int(np.searchsorted(SHIFTS_PX, FIT_TO_PX))) + 1)
    a, b = (float(c) for c in coefficients(SHIFTS_PX[:used], curve.rmsd[:used]))
    half = rmsd.shape[1] // 2  # opposite directions have nearly the same RMSD
    of_directions = coefficients(SHIFTS_PX[:used], (rmsd[:used, :half] + rmsd[:used, half:]) / 2)
    by_direction = tuple((float(one), float(other)) for one, other in zip(*of_directions, strict=True))
    r2 = float(determination(a, b, np.repeat(SHIFTS_PX[:used], rmsd.shape[1]), rmsd[:used].ravel()))
    return Calibration(a, b, r2, float(SHIFTS_PX[end]), window_px, float(curve.rmsd[end]), by_direction), curve


def is_flat(rmsd: FloatArray) -> bool:
    """Whether shifts have no effect beyond rounding errors, so that there is nothing to calibrate."""
    return bool(rmsd.max() < _FLAT)


def coefficients(shift_px: FloatArray, rmsd: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Non-negative coefficients a and b (...) of Eq. 3 for RMSD (S, ...) of shifts by `shift_px` (S,); 0 without RMSD.

    Weighted least squares. The weight is the inverse square of the accepted error at each displacement, so that small
    displacements are accurate, too.
    """
    d = shift_px.reshape(-1, *[1] * (rmsd.ndim - 1))
    fade = np.clip(1 - _FADE_PER_PX * (d - _FADE_START_PX), 0, 1)
    weight = fade / np.maximum(_TOLERANCE_SHARE * d, _TOLERANCE_PX) ** 2
    m2, m3, m4 = (np.sum(weight * rmsd**n, axis=0) for n in (2, 3, 4))
    d1, d2 = (np.sum(weight * d * rmsd**n, axis=0) for n in (1, 2))
    determinant = m4 * m2 - m3 * m3
    a = _ratio(d2 * m2 - d1 * m3, determinant)
    b = _ratio(d1 * m4 - d2 * m3, determinant)
    a, b = np.where(b < 0, _ratio(d2, m4), a), np.where(a < 0, _ratio(d1, m2), b)
    return np.maximum(a, 0), np.maximum(b, 0)


def determination(a: FloatArray | float, b: FloatArray | float, shift_px: FloatArray, rmsd: FloatArray) -> FloatArray:
    """Coefficient of determination (...) of Eq. 3 with a and b (...) for RMSD (S, ...) of shifts `shift_px` (S,)."""
    d = shift_px.reshape(-1, *[1] * (rmsd.ndim - 1))
    misfit = np.sum((d - a * rmsd**2 - b * rmsd) ** 2, axis=0)
    return np.asarray(1 - misfit / np.sum((d - d.mean()) ** 2))


def _ratio(above: FloatArray, below: FloatArray) -> FloatArray:
    """Quotient; 0 where `below` is not positive."""
    return np.asarray(above / np.where(below > 0, below, np.inf))


def _last_rising(rmsd: FloatArray) -> int:
    """Index of the last shift before the curve reaches its plateau or falls."""
    falls = np.flatnonzero(np.diff(rmsd) <= 0)
    highest = int(falls[0]) if len(falls) else len(rmsd) - 1
    return int(np.flatnonzero(rmsd >= _PLATEAU * rmsd[highest])[0])
