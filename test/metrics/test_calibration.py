"""d(RMSD), Eq. 3 of Ljubicic et al. (2021): curve and fit against independent ones, range, and where points stand."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
import pytest
from truth import IDENTITY, flat, picture, translation

from stab_ros.core.errors import InputError
from stab_ros.core.types import BoolArray, FloatArray, Gray
from stab_ros.metrics._r2_map import quality_map
from stab_ros.metrics._shift_response import SHIFTS_PX, ShiftResponse
from stab_ros.metrics.calibration import Calibration, Curve, coefficients, determination, fit_calibration
from stab_ros.metrics.rmsd import cut, rmsd
from stab_ros.metrics.verification import WINDOWS_PX, VerificationPoint, calibrated_points, choose_points

SIZE = (640, 480)
CENTRE = (300, 220)
ANYWHERE: BoolArray = np.ones(SIZE[::-1], bool)


@cache
def ground(noise: float = 0.0) -> Gray:
    return picture(IDENTITY, SIZE, noise=noise)


@cache
def chosen(noise: float = 0.0, window_px: int = 31) -> tuple[VerificationPoint, ...]:
    return choose_points(ground(noise), ANYWHERE, 12, window_px, noise)


def calibrate(reference: Gray, centre_px: tuple[int, int], window_px: int,
              noise_sigma: float) -> tuple[Calibration, Curve]:
    """Eq. 3 for one window about one point of an image."""
    return fit_calibration(ShiftResponse(reference, noise_sigma).rmsd(centre_px, [window_px])[0], window_px)


@pytest.mark.parametrize("distance_px", [0.25, 1.0, 3.0, 6.0])
def test_the_curve_is_the_rmsd_of_pictures_that_are_really_shifted(distance_px: float) -> None:
    """Rendered anew at each shift, in eight directions; the curve knows the unshifted picture alone."""
    _, curve = calibrate(ground(), CENTRE, 31, 0.0)
    here, seen = np.array([CENTRE]), []
    for angle in np.arange(8) * np.pi / 4:
        x, y = distance_px * np.cos(angle), distance_px * np.sin(angle)
        shifted = picture(translation(-x, -y), SIZE, noise=0)
        seen.append(rmsd(cut(ground(), here, 31), cut(shifted, here, 31))[0])
    told = np.interp(distance_px, curve.shift_px, curve.rmsd)
    assert told == pytest.approx(np.mean(seen), rel=0.02)


def test_the_noise_of_the_reference_is_not_in_the_curve() -> None:
    clean = calibrate(ground(), CENTRE, 31, 0.0)[1].rmsd
    noisy = calibrate(ground(3.0), CENTRE, 31, 3.0)[1].rmsd
    assert noisy == pytest.approx(clean, rel=0.05)


def test_a_polynomial_is_found_again() -> None:
    """RMSD that follows d = 0.01 R^2 + 0.05 R exactly gives a, b and R^2 = 1."""
    d = SHIFTS_PX[:12]
    r = (-0.05 + np.sqrt(0.05**2 + 4 * 0.01 * d)) / 0.02
    a, b = coefficients(d, r)
    assert (float(a), float(b)) == pytest.approx((0.01, 0.05))
    assert float(determination(a, b, d, r)) == pytest.approx(1)
    found = Calibration(float(a), float(b), 1.0, 5.0, 31)
    assert found.displacement_px(r) == pytest.approx(d)


def test_the_fit_is_the_weighted_least_squares_without_intercept() -> None:
    """Against numpy's solver, on a curve that is no polynomial."""
    calibration, curve = calibrate(ground(), CENTRE, 31, 0.0)
    d, r = (values[curve.shift_px <= 5] for values in (curve.shift_px, curve.rmsd))
    root = np.sqrt(np.clip(1 - 0.8 * (d - 4.25), 0, 1)) / np.maximum(0.15 * d, 0.05)
    (a, b), *_ = np.linalg.lstsq(np.stack([r * r, r], axis=1) * root[:, None], d * root, rcond=None)
    assert a > 0 < b, "else it is another fit"
    assert (calibration.a, calibration.b) == pytest.approx((a, b))


@pytest.mark.parametrize(("d", "expected"), [
    (lambda r: 0.02 * r**2 - 0.05 * r, "b"), (lambda r: 0.5 * r - 0.01 * r**2, "a")])
def test_no_coefficient_is_negative_so_that_more_rmsd_is_never_less_displacement(
        d: Callable[[FloatArray], FloatArray], expected: str) -> None:
    r = np.linspace(3, 20, 10)
    a, b = coefficients(d(r), r)
    assert min(float(a), float(b)) == 0 < max(float(a), float(b))
    assert {"a": a, "b": b}[expected] == 0


def test_beyond_its_range_a_displacement_is_cut_and_told() -> None:
    found = Calibration(0.01, 0.05, 0.99, 5.0, 31, range_rmsd=20.0)
    assert found.displacement_px(np.array([0.0, 10.0, 21.0, 100.0, np.nan])) == pytest.approx(
        [0.0, 1.5, 5.0, 5.0, np.nan], nan_ok=True)
    assert found.beyond(np.array([0.0, 10.0, 20.5, 100.0, np.nan])).tolist() == [False, False, True, True, False]


def test_the_range_ends_where_rmsd_rises_no_more() -> None:
    """A chequered pattern of 12 px is farthest out of step at 6 px along its axes, and at 8.5 px aslant."""
    x, y = np.meshgrid(np.arange(SIZE[0]), np.arange(SIZE[1]))
    stripes = 128 + 40 * np.sin(2 * np.pi * x / 12) + 40 * np.sin(2 * np.pi * y / 12)
    found, curve = calibrate(np.asarray(np.round(stripes), np.uint8), CENTRE, 31, 0.0)
    assert 3 <= found.range_px <= curve.shift_px[curve.rmsd.argmax()] <= 7


def test_without_texture_there_is_no_calibration_and_no_point() -> None:
    plain = np.full(SIZE[::-1], 90, np.uint8)
    with pytest.raises(ValueError, match="without texture"):
        calibrate(plain, CENTRE, 31, 0.0)
    assert choose_points(plain, ANYWHERE, 12, 31, 0.0) == ()
    assert choose_points(flat(size=SIZE), ANYWHERE, 12, 31, 2.0) == ()
    with pytest.raises(InputError, match="point 'P' at \\(300, 220\\): too little texture"):
        calibrated_points(plain, [("P", *CENTRE)], 31, 0.0)


@pytest.mark.parametrize("coefficients_and_range", [(-0.1, 1, 5), (0, 0, 5), (1, 1, 0)])
def test_a_calibration_checks_itself(coefficients_and_range: tuple[float, float, float]) -> None:
    a, b, range_px = coefficients_and_range
    with pytest.raises(ValueError, match="must not be negative"):
        Calibration(a, b, 1.0, range_px, 31)


def test_points_are_well_textured_spread_and_named_from_the_top() -> None:
    points = chosen()
    places = np.array([(point.x_px, point.y_px) for point in points])
    assert [point.name for point in points] == [f"V{number}" for number in range(1, 13)]
    assert np.all(np.diff(places[:, 1]) >= 0)
    apart = np.abs(places[:, None] - places).max(axis=2) + 1000 * np.eye(12)
    assert apart.min() >= 31, "windows do not overlap"
    assert all(point.calibration.r2 > 0.9 for point in points)
    by_chance = [calibrate(ground(), (x, y), 31, 0.0)[0].r2 for x in range(60, 600, 90) for y in range(60, 440, 90)]
    assert min(point.calibration.r2 for point in points) > np.median(by_chance)
    thirds = {(x // 214, y // 240) for x, y in places.tolist()}
    assert len(thirds) >= 5, "of 3 x 2 fields"


def test_points_lie_where_they_are_allowed() -> None:
    allowed = np.zeros_like(ANYWHERE)
    allowed[100:300, 50:400] = True
    points = choose_points(ground(), allowed, 12, 31, 0.0)
    assert points
    assert all(allowed[p.y_px - 15 : p.y_px + 16, p.x_px - 15 : p.x_px + 16].all() for p in points)
    assert choose_points(ground(), np.zeros_like(ANYWHERE), 12, 31, 0.0) == ()
    assert choose_points(ground(), ANYWHERE, 0, 31, 0.0) == ()


def test_texture_is_preferred() -> None:
    """The left half is nearly flat."""
    half = ground().astype(np.float64)
    half[:, :320] = 128 + (half[:, :320] - 128) / 30
    points = choose_points(np.asarray(np.round(half), np.uint8), ANYWHERE, 12, 31, 0.0)
    assert points
    assert min(point.x_px for point in points) > 320


def test_the_window_is_that_of_the_highest_r2() -> None:
    points = chosen(window_px=0)
    (window_px,) = {point.calibration.window_px for point in points}
    assert window_px in WINDOWS_PX
    places = [(point.name, float(point.x_px), float(point.y_px)) for point in points]
    found = calibrated_points(ground(), places, 0, 0.0)[0].calibration.window_px
    mean_r2 = {n: np.mean([p.calibration.r2 for p in calibrated_points(ground(), places, n, 0.0)]) for n in WINDOWS_PX}
    assert found == max(mean_r2, key=lambda n: float(mean_r2[n]))


def test_points_of_the_user_are_taken_as_they_are() -> None:
    points = calibrated_points(ground(), [("left", 100.4, 99.6), ("right", 500, 300)], 31, 0.0)
    assert [(point.name, point.x_px, point.y_px) for point in points] == [("left", 100, 100), ("right", 500, 300)]
    assert points[1].calibration == calibrate(ground(), (500, 300), 31, 0.0)[0]
    with pytest.raises(InputError, match="point 'edge' at \\(5, 100\\): its window of 31 px leaves the 640x480"):
        calibrated_points(ground(), [("edge", 5, 100)], 31, 0.0)
    with pytest.raises(ValueError, match="must be odd"):
        calibrated_points(ground(), [("left", 100, 100)], 30, 0.0)


def test_the_quality_map_ranks_as_the_full_calibration() -> None:
    """A first choice by whole pixels alone must agree with the fit over sub-pixel shifts."""
    rough = quality_map(ground(), 31, 0.0)
    places = [(x, y) for x in range(62, 600, 60) for y in range(62, 440, 60)]
    fine: FloatArray = np.array([calibrate(ground(), place, 31, 0.0)[0].r2 for place in places])
    coarse = np.array([rough[y // 4, x // 4] for x, y in places])
    order = [np.argsort(np.argsort(values)).astype(np.float64) for values in (fine, coarse)]
    assert np.corrcoef(order[0], order[1])[0, 1] > 0.6


def test_a_shift_response_is_the_same_for_several_windows_at_once() -> None:
    response = ShiftResponse(ground(), 0.0)
    together = response.rmsd(CENTRE, (15, 31, 51))
    assert together.shape == (3, len(SHIFTS_PX), 8)
    for index, window_px in enumerate((15, 31, 51)):
        assert together[index] == pytest.approx(response.rmsd(CENTRE, [window_px])[0], rel=1e-5)
