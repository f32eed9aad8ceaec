"""Verification points, at which a stabilized image is compared with the reference, and their calibration.

Ljubicic et al. (2021, section 3.2) choose the candidates with the highest R^2 of d(RMSD); here they are also spread
over the image. This favours features of 5 to 15 px: on fine gravel, RMSD soon reaches a plateau that no polynomial
fits.
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
from stab_ros.metrics._shift_response import MARGIN_PX, ShiftResponse
from stab_ros.metrics.calibration import Calibration, Curve, fit_calibration, is_flat

WINDOWS_PX = (15, 19, 23, 27, 31, 35, 39, 43, 47, 51)
_MAP_WINDOW_PX = 31  # of the candidates, if the window is chosen automatically
_PER_CELL = 4  # candidates per cell; the number of cells is about the number of points
_CROWDING_PENALTY = 0.05  # of quality, for a point next to another one
_QUALITY_MARGIN = 0.05  # largest difference of quality to the best few
_BEST_FEW = 6
_GOOD_RANGE_PX = 5.0
_MIN_R2 = 0.6
_MIN_STRENGTH, _MIN_STRENGTH_TO_NOISE = 1.0, 0.6  # RMSD at 1 px, grey levels and ratio to the noise


@dataclass(frozen=True, eq=False)
class VerificationPoint:
    """A point of the reference (x_px, y_px), the centre of its window, with its calibration."""

    name: str
    x_px: int
    y_px: int
    calibration: Calibration
    curve: Curve


def choose_points(reference: Gray, allowed: BoolArray, count: int, window_px: int,
                  noise_sigma: float) -> tuple[VerificationPoint, ...]:
    """Automatic verification points, named V1, V2, ... from top to bottom; fewer if the image lacks good ones.

    Args:
        reference: (h, w) uint8.
        allowed: (h, w) bool, must contain each window and the pixels around it that the calibration reads.
        count: largest number of points.
        window_px: side of the window, odd; 0 chooses that of WINDOWS_PX with the highest mean R^2 (section 3.2).
        noise_sigma: standard deviation of the noise of the reference, grey levels.

    Raises:
        ValueError: an even window.
    """
    windows, placeable = _fitting_windows(allowed, _windows(window_px))
    if count < 1 or not placeable.any():
        return ()
    spacing_px = float(np.sqrt(placeable.sum() / count))
    map_window_px = window_px or min(_MAP_WINDOW_PX, windows[-1])
    places = candidates(reference, placeable, map_window_px, noise_sigma, spacing_px, _PER_CELL)
    found = _calibrate_all(reference, [("", *place) for place in places.tolist()], windows, noise_sigma)
    useful = [point for point in found if point.calibration.r2 >= _MIN_R2 and _has_texture(point, noise_sigma)]
    chosen = _good_enough(_spread(useful, count, spacing_px, noise_sigma), noise_sigma)
    ordered = sorted(chosen, key=lambda point: (point.y_px, point.x_px))
    return tuple(replace(point, name=f"V{number}") for number, point in enumerate(ordered, 1))


def calibrated_points(reference: Gray, named: Sequence[tuple[str, float, float]], window_px: int,
                      noise_sigma: float) -> tuple[VerificationPoint, ...]:
    """Verification points given by the user.

    Args:
        reference: (h, w) uint8.
        named: name, x and y of each point, px; rounded to whole pixels.
        window_px: see `choose_points`.
        noise_sigma: see `choose_points`.

    Raises:
        InputError: the window of a point is not completely inside the image, or has too little texture.
        ValueError: an even window.
    """
    places = [(name, round(x), round(y)) for name, x, y in named]
    windows = _windows(window_px)
    for place in places:
        _check_inside(place, windows[0], reference.shape)
    windows = tuple(n for n in windows if all(_is_inside(place, n, reference.shape) for place in places))
    points = _calibrate_all(reference, places, windows, noise_sigma)
    with_texture = {point.name for point in points if _has_texture(point, noise_sigma)}
    for name, x, y in places:
        if name not in with_texture:
            raise InputError(f"point {name!r} at ({x}, {y}): too little texture to measure a shift, "
                             "it must lie on something static with structure in both directions")
    return points


def _calibrate_all(reference: Gray, places: Sequence[tuple[str, int, int]], windows: tuple[int, ...],
                noise_sigma: float) -> tuple[VerificationPoint, ...]:
    """The points (name, x, y) with texture, all with the window that has the highest mean R^2."""
    response = ShiftResponse(reference, noise_sigma)
    by_window: dict[int, list[VerificationPoint]] = {window: [] for window in windows}
    for name, x, y in places:
        for window, rmsd in zip(windows, response.rmsd((x, y), windows), strict=True):
            if not is_flat(rmsd):
                by_window[window].append(VerificationPoint(name, x, y, *fit_calibration(rmsd, window)))
    best = max(by_window.values(), key=_mean_r2)
    return tuple(best)


def _mean_r2(points: Sequence[VerificationPoint]) -> float:
    return sum(point.calibration.r2 for point in points) / len(points) if points else -math.inf


def _spread(points: Sequence[VerificationPoint], count: int, spacing_px: float,
            noise_sigma: float) -> list[VerificationPoint]:
    """At most `count` points with disjoint windows, best first, with a penalty for points close to chosen ones."""
    left = [(point, _quality(point, noise_sigma)) for point in points]
    chosen: list[VerificationPoint] = []
    while left and len(chosen) < count:
        best, _ = max(left, key=lambda item: item[1])
        chosen.append(best)
        apart = [(item, _distance_px(item[0], best)) for item in left]
        left = [(point, value - _CROWDING_PENALTY * max(0.0, 1 - distance / spacing_px))
                for (point, value), distance in apart if distance >= best.calibration.window_px]
    return chosen


def _good_enough(points: Sequence[VerificationPoint], noise_sigma: float) -> list[VerificationPoint]:
    """The points whose quality is close to that of the best few."""
    values = [_quality(point, noise_sigma) for point in points]
    bar = sorted(values, reverse=True)[min(_BEST_FEW, len(values)) - 1] - _QUALITY_MARGIN if values else 0
    return [point for point, value in zip(points, values, strict=True) if value >= bar]


def _quality(point: VerificationPoint, noise_sigma: float) -> float:
    in_range = min(1.0, point.calibration.range_px / _GOOD_RANGE_PX)
    return in_range * float(quality(point.calibration.r2, point.curve.strength, noise_sigma))


def _has_texture(point: VerificationPoint, noise_sigma: float) -> bool:
    return point.curve.strength >= max(_MIN_STRENGTH, _MIN_STRENGTH_TO_NOISE * noise_sigma)


def _distance_px(a: VerificationPoint, b: VerificationPoint) -> int:
    return max(abs(a.x_px - b.x_px), abs(a.y_px - b.y_px))


def _windows(window_px: int) -> tuple[int, ...]:
    if window_px == 0:
        return WINDOWS_PX
    if window_px < 3 or window_px % 2 == 0:
        raise ValueError(f"a window of {window_px} px, it must be odd, or 0 to be chosen")
    return (window_px,)


def _fitting_windows(allowed: BoolArray, windows: tuple[int, ...]) -> tuple[tuple[int, ...], BoolArray]:
    """The windows up to the largest that fits into `allowed`, and the mask (h, w) of its possible centres."""
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
                         f"image, it must be {window_px // 2} px from every side")


def _is_inside(place: tuple[str, int, int], window_px: int, shape: tuple[int, ...]) -> bool:
    half = window_px // 2
    _, x, y = place
    return half <= x < shape[1] - half and half <= y < shape[0] - half
