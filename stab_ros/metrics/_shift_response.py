"""RMSD (Ljubicic et al. 2021, Eq. 2) of an image against itself as a function of a known shift.

Shifts in eight directions are interpolated by a windowed sinc, because OpenCV's warps round shifts to 1/32 px. The
contribution of the image's noise to the RMSD follows exactly from the taps of the sinc, and is subtracted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import cv2
import numpy as np

from stab_ros.core.kernels import F32, F64, I64, filled, kernel, read
from stab_ros.core.types import FloatArray, Gray, IdArray

SHIFTS_PX = np.array([0.1, 0.25, 0.5, 0.75, 1, 1.5, 2, 2.5, 3, 3.5, 4, 4.5, 5, 5.5, 6, 6.5, 7, 7.5, 8])
DIRECTIONS = 8
_SINC_RADIUS = 6  # px
MARGIN_PX = int(SHIFTS_PX[-1]) + _SINC_RADIUS  # number of px read around a window


class ShiftResponse:
    """Noise-corrected RMSD of an image against itself for all of SHIFTS_PX in all directions."""

    def __init__(self, reference: Gray, noise_sigma: float) -> None:
        """reference: (h, w) uint8. noise_sigma: standard deviation of its white noise, grey levels."""
        border = (MARGIN_PX,) * 4
        self._image = cv2.copyMakeBorder(reference, *border, cv2.BORDER_REFLECT_101).astype(np.float32)
        self._noise_variance = noise_sigma**2

    def rmsd(self, centre_px: tuple[int, int], windows_px: Sequence[int]) -> FloatArray:
        """RMSD (windows, shifts, directions) float64, grey levels, for windows of odd sides about one centre (x, y)."""
        half = np.asarray(windows_px) // 2
        x, y = (c + MARGIN_PX for c in centre_px)
        shifts = _shifts()
        rings = _ring_squares(self._image, x, y, int(half.max()), shifts.whole_px, shifts.taps)
        means = np.cumsum(rings, axis=1)[:, half] / (2 * half + 1.0) ** 2
        free = np.maximum(means - self._noise_variance * shifts.noise_share[:, None], 0)
        return np.asarray(np.sqrt(free).T.reshape(len(half), len(SHIFTS_PX), DIRECTIONS))


@dataclass(frozen=True, eq=False)
class _Shifts:
    """All S = shifts x directions shifts, as integer parts and interpolation taps of the fractional parts.

    Attributes:
        whole_px: (S, 2) int64, x and y.
        taps: (S, 2, 2 radius) float32.
        noise_share: (S,) variance of shifted minus unshifted white noise of variance 1.
    """

    whole_px: IdArray
    taps: FloatArray
    noise_share: FloatArray


@cache
def _shifts() -> _Shifts:
    angle = np.arange(DIRECTIONS) * 2 * np.pi / DIRECTIONS
    unit = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    source = np.round(-SHIFTS_PX[:, None, None] * unit, 9).reshape(-1, 2)  # position before the shift
    whole = np.floor(source)
    taps = _sinc_taps(source - whole)
    self_weight = np.array([_self_weight(*pair) for pair in zip(whole.astype(np.int64), taps, strict=True)])
    noise_share = 1 + np.prod(np.sum(taps**2, axis=2), axis=1) - 2 * self_weight
    return _Shifts(whole.astype(np.int64), taps.astype(np.float32), noise_share)


def _sinc_taps(fraction: FloatArray) -> FloatArray:
    """Taps (S, 2, 2 radius) float64 of a Kaiser-windowed sinc that samples `fraction` (S, 2) after the middle tap."""
    t = fraction[..., None] - np.arange(1 - _SINC_RADIUS, _SINC_RADIUS + 1)
    taps = np.sinc(t) * np.i0(7 * np.sqrt(np.clip(1 - (t / _SINC_RADIUS) ** 2, 0, None)))
    return np.asarray(taps / taps.sum(axis=-1, keepdims=True))


def _self_weight(whole_px: IdArray, taps: FloatArray) -> float:
    """Weight of the compared pixel itself in the interpolation of the shifted pixel."""
    column, row = _SINC_RADIUS - 1 - whole_px
    inside = 0 <= column < 2 * _SINC_RADIUS and 0 <= row < 2 * _SINC_RADIUS
    return float(taps[0, column] * taps[1, row]) if inside else 0.0


@kernel((read(F32, 2), I64, I64, I64, read(I64, 2), read(F32, 3)))
def _ring_squares(image: Any, x: int, y: int, half: int, whole_px: Any, taps: Any) -> Any:
    """Sums (S, half + 1) of squared differences between image and shifted image over square rings about (x, y).

    Cumulative sums over the rings give the result of all windows up to 2 half + 1 at once.
    """
    side, reach = 2 * half + 1, taps.shape[2]
    rings = np.zeros((len(whole_px), half + 1))
    wide = np.empty((side + reach - 1, side), np.float32)
    line = np.empty(side, np.float32)
    for s in range(len(whole_px)):
        left = x - half + whole_px[s, 0] - reach // 2 + 1
        top = y - half + whole_px[s, 1] - reach // 2 + 1
        for row in range(side + reach - 1):
            _weighted(image[top + row], left, taps[s, 0], wide[row])
        for row in range(side):
            line[:] = 0
            for tap in range(reach):
                if taps[s, 1, tap] != 0:
                    _add(taps[s, 1, tap], wide[row + tap], line)
            _add_to_rings(line, image[y - half + row, x - half : x + half + 1], abs(row - half), rings[s])
    return rings


@kernel((read(F32, 1), I64, read(F32, 1), filled(F32, 1)))
def _weighted(source: Any, left: int, taps: Any, out: Any) -> None:
    out[:] = 0
    for tap in range(len(taps)):
        if taps[tap] != 0:
            _add(taps[tap], source[left + tap : left + tap + len(out)], out)


@kernel((F32, read(F32, 1), filled(F32, 1)))
def _add(weight: float, source: Any, out: Any) -> None:
    for column in range(len(out)):
        out[column] += weight * source[column]


@kernel((filled(F32, 1), read(F32, 1), I64, filled(F64, 1)))
def _add_to_rings(line: Any, plain: Any, ring_of_row: int, rings: Any) -> None:
    half = len(rings) - 1
    for column in range(len(line)):
        line[column] = (line[column] - plain[column]) ** 2
    for column in range(half - ring_of_row, half + ring_of_row + 1):
        rings[ring_of_row] += line[column]
    for ring in range(ring_of_row + 1, half + 1):
        rings[ring] += line[half - ring] + line[half + ring]
