"""Where the stabilised picture is compared with the reference: verification points, and what their RMSD means.

Ljubicic et al. (2021, 3.2) take those of many candidates that have the highest R^2 of d(RMSD). So do we, spread over
the picture. Features of 5 to 15 px win by themselves: over fine gravel RMSD soon stops rising, and no polynomial
follows that.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from stab_ros.core.errors import InputError
from stab_ros.core.types import BoolArray, Gray
from stab_ros.metrics._r2_map import candidates, quality
from stab_ros.metrics._shift_response import MARGIN_PX, Sweep
from stab_ros.metrics.calibration import Calibration, Curve, fitted, is_flat

WINDOWS_PX = (15, 19, 23, 27, 31, 35, 39, 43, 47, 51)
_MAP_WINDOW_PX = 31  # where the window is still to be chosen
_PER_CELL = 4  # candidates; there are about as many cells as points wanted
_CROWDED = 0.05  # of quality that a point right beside another one must be better by
_WORSE = 0.05  # of quality that a point may be worse by than the best few
_FEW = 6
_GOOD_RANGE_PX = 5.0
_LEAST_R2 = 0.6
_LEAST_STRENGTH, _LEAST_STRENGTH_NOISES = 1.0, 0.6  # RMSD at 1 px, in grey levels and in units of the noise


@dataclass(frozen=True, eq=False)
class VerificationPoint:
    """A point of the reference, the middle of its window, with what was calibrated there."""

    name: str
    x_px: int
    y_px: int
    calibration: Calibration
    curve: Curve


def choose_points(reference: Gray, allowed: BoolArray, count: int, window_px: int,
                  noise_sigma: float) -> tuple[VerificationPoint, ...]:
    """At most `count` verification points of `reference` (h, w) uint8, named V1, V2, ... from the top down.

    allowed: (h, w) bool, where a window and what its calibration reads around it must lie. window_px: N, odd; 0 takes
    that of WINDOWS_PX with the highest mean R^2 (3.2). noise_sigma: of the reference, grey levels. Fewer points, down
    to none, where the picture has no more that are worth it.

    Raises:
        ValueError: an even window.
    """
    windows, possible = _that_fit(allowed, _windows(window_px))
    if count < 1 or not possible.any():
        return ()
    spacing_px = float(np.sqrt(possible.sum() / count))
    map_window_px = window_px or min(_MAP_WINDOW_PX, windows[-1])
    places = candidates(reference, possible, map_window_px, noise_sigma, spacing_px, _PER_CELL)
    found = _calibrated(reference, [("", *place) for place in places.tolist()], windows, noise_sigma)
    useful = [point for point in found if point.calibration.r2 >= _LEAST_R2 and _has_texture(point, noise_sigma)]
    chosen = _worthwhile(_spread(useful, count, spacing_px, noise_sigma), noise_sigma)
    ordered = sorted(chosen, key=lambda point: (point.y_px, point.x_px))
    return tuple(replace(point, name=f"V{number}") for number, point in enumerate(ordered, 1))


def calibrated_points(reference: Gray, named: Sequence[tuple[str, float, float]], window_px: int,
                      noise_sigma: float) -> tuple[VerificationPoint, ...]:
    """The points a user names (name, x, y, px), rounded to pixels; window and noise as for `choose_points`.

    Raises:
        InputError: a point whose window leaves the picture, or holds too little texture to tell a shift by.
        ValueError: an even window.
    """
    places = [(name, round(x), round(y)) for name, x, y in named]
    windows = _windows(window_px)
    for place in places:
        _check_inside(place, windows[0], reference.shape)
    windows = tuple(n for n in windows if all(_is_inside(place, n, reference.shape) for place in places))
    points = _calibrated(reference, places, windows, noise_sigma)
    with_texture = {point.name for point in points if _has_texture(point, noise_sigma)}
    for name, x, y in places:
        if name not in with_texture:
            raise InputError(f"point {name!r} at ({x}, {y}): too little texture to tell a shift by, "
                             "it must lie on something static with structure in both directions")
    return points


def _calibrated(reference: Gray, places: Sequence[tuple[str, int, int]], windows: tuple[int, ...],
                noise_sigma: float) -> tuple[VerificationPoint, ...]:
    """The places (name, x, y) with texture, all with that one of the windows that has the highest mean R^2."""
    sweep = Sweep(reference, noise_sigma)
    by_window: dict[int, list[VerificationPoint]] = {window: [] for window in windows}
    for name, x, y in places:
        for window, rmsd in zip(windows, sweep.rmsd((x, y), windows), strict=True):
            if not is_flat(rmsd):
                by_window[window].append(VerificationPoint(name, x, y, *fitted(rmsd, window)))
    best = max(by_window.values(), key=_mean_r2)
    return tuple(best)


def _mean_r2(points: Sequence[VerificationPoint]) -> float:
    return sum(point.calibration.r2 for point in points) / len(points) if points else -math.inf


def _spread(points: Sequence[VerificationPoint], count: int, spacing_px: float,
            noise_sigma: float) -> list[VerificationPoint]:
    """At most `count` points whose windows do not overlap, the best first; crowded ones must be better than others."""
    left = [(point, _quality(point, noise_sigma)) for point in points]
    chosen: list[VerificationPoint] = []
    while left and len(chosen) < count:
        best, _ = max(left, key=lambda item: item[1])
        chosen.append(best)
        apart = [(item, _distance_px(item[0], best)) for item in left]
        left = [(point, value - _CROWDED * max(0.0, 1 - distance / spacing_px))
                for (point, value), distance in apart if distance >= best.calibration.window_px]
    return chosen


def _worthwhile(points: Sequence[VerificationPoint], noise_sigma: float) -> list[VerificationPoint]:
    """Those that are hardly worse than the best few."""
    values = [_quality(point, noise_sigma) for point in points]
    bar = sorted(values, reverse=True)[min(_FEW, len(values)) - 1] - _WORSE if values else 0
    return [point for point, value in zip(points, values, strict=True) if value >= bar]


def _quality(point: VerificationPoint, noise_sigma: float) -> float:
    in_range = min(1.0, point.calibration.range_px / _GOOD_RANGE_PX)
    return in_range * float(quality(point.calibration.r2, point.curve.strength, noise_sigma))


def _has_texture(point: VerificationPoint, noise_sigma: float) -> bool:
    return point.curve.strength >= max(_LEAST_STRENGTH, _LEAST_STRENGTH_NOISES * noise_sigma)


def _distance_px(a: VerificationPoint, b: VerificationPoint) -> int:
    return max(abs(a.x_px - b.x_px), abs(a.y_px - b.y_px))


def _windows(window_px: int) -> tuple[int, ...]:
    if window_px == 0:
        return WINDOWS_PX
    if window_px < 3 or window_px % 2 == 0:
        raise ValueError(f"a window of {window_px} px, it must be odd, or 0 to be chosen")
    return (window_px,)


def _that_fit(allowed: BoolArray, windows: tuple[int, ...]) -> tuple[tuple[int, ...], BoolArray]:
    """The windows up to the largest that has a place, and where that is."""
    for last in range(len(windows), 0, -1):
        side = windows[last - 1] + 2 * MARGIN_PX
        inner = cv2.erode(allowed.astype(np.uint8), np.ones((side, side), np.uint8),
                          borderType=cv2.BORDER_CONSTANT, borderValue=0)
        if inner.any():
            break
    return windows[:last], inner.astype(bool)


def _check_inside(place: tuple[str, int, int], window_px: int, shape: tuple[int, ...]) -> None:
    if not _is_inside(place, window_px, shape):
        name, x, y = place
        raise InputError(f"point {name!r} at ({x}, {y}): its window of {window_px} px leaves the {shape[1]}x{shape[0]} "
                         f"picture, it must be {window_px // 2} px from every side")


def _is_inside(place: tuple[str, int, int], window_px: int, shape: tuple[int, ...]) -> bool:
    half = window_px // 2
    _, x, y = place
    return half <= x < shape[1] - half and half <= y < shape[0] - half
