"""Shifts of interrogation areas: exact truth, a naive correlation as oracle, and what must not be measured."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest
from truth import IDENTITY, SIZE, flat, picture, random_noise, similarity, translation

from stab_ros.core.geometry import apply
from stab_ros.core.types import FloatArray, Gray, Homography
from stab_ros.metrics.correlation import Correlator

CENTRES = np.stack(np.meshgrid(np.arange(60, 345, 40), np.arange(60, 245, 40)), axis=-1).reshape(-1, 2)
REFERENCE = picture(noise=0)
RESIDUALS_PX = (0.05, 0.2, 0.5, 1.0, 2.0, 4.0)


@cache
def correlator(noise: float = 0.0) -> Correlator:
    return Correlator(picture(IDENTITY, noise=noise), CENTRES)


def moved(u: float, v: float, *, noise: float = 0.0, gain: float = 1.0, offset: float = 0.0, seed: int = 1) -> Gray:
    """The reference's ground, its content moved by (u, v) px."""
    return picture(translation(-u, -v), seed=seed, noise=noise, gain=gain, offset=offset)


def at(length_px: float, degrees: float) -> FloatArray:
    return length_px * np.array([np.cos(np.radians(degrees)), np.sin(np.radians(degrees))])


@pytest.mark.parametrize("length_px", RESIDUALS_PX)
def test_a_known_shift_is_found_in_any_direction(length_px: float) -> None:
    for degrees in (0, 37, 90, 141, 200, 288):
        shift = at(length_px, degrees)
        error = correlator().shifts(moved(shift[0], shift[1])) - shift
        assert np.abs(error).max() < 0.005
        assert np.abs(error.mean(axis=0)).max() < 0.001


@pytest.mark.parametrize("length_px", RESIDUALS_PX)
def test_noise_makes_it_uncertain_but_not_biased(length_px: float) -> None:
    shift = at(length_px, 65)
    error = correlator(2.0).shifts(moved(shift[0], shift[1], noise=2.0)) - shift
    assert np.abs(error).max() < 0.03
    assert np.abs(error.mean(axis=0)).max() < 0.005


def test_the_fraction_of_a_pixel_draws_the_result_nowhere() -> None:
    """Peak locking: errors that go to and fro with the fraction."""
    errors = [correlator().shifts(moved(u, 0.0))[:, 0].mean() - u for u in np.arange(0.0, 1.01, 0.125)]
    assert np.ptp(errors) < 0.001


def test_it_agrees_with_a_naive_correlation() -> None:
    """Pearson's coefficient, summed pixel by pixel for every lag, with a parabola through the highest."""
    current = moved(2.4, -3.3, noise=1.0)
    shifts = correlator().shifts(current)
    for centre, shift in zip(CENTRES[::7], shifts[::7], strict=True):
        assert shift == pytest.approx(naive_shift(REFERENCE, current, centre), abs=0.1)


def naive_shift(reference: Gray, current: Gray, centre: FloatArray, reach: int = 6) -> FloatArray:
    left, top = centre - 32
    template = reference[top : top + 64, left : left + 64].astype(float)
    best = {
        (x, y): np.corrcoef(template.ravel(), current[top + y : top + y + 64, left + x : left + x + 64].ravel())[0, 1]
        for x in range(-reach, reach + 1) for y in range(-reach, reach + 1)
    }
    x, y = max(best, key=lambda lag: best[lag])
    return np.array([x + top_of_parabola(best[x - 1, y], best[x, y], best[x + 1, y]),
                     y + top_of_parabola(best[x, y - 1], best[x, y], best[x, y + 1])])


def top_of_parabola(before: float, middle: float, after: float) -> float:
    return (before - after) / (2 * (before - 2 * middle + after))


def test_brightness_contrast_and_a_shadow_edge_far_away_do_not_move_anything() -> None:
    error = correlator().shifts(moved(0.3, -0.2, gain=1.05, offset=-7.0)) - (0.3, -0.2)
    assert np.abs(error).max() < 0.005
    lit = moved(0.3, -0.2) * np.linspace(0.8, 1.1, SIZE[0])  # light that changes across the picture
    error = correlator().shifts(np.asarray(np.clip(np.round(lit), 0, 255), np.uint8)) - (0.3, -0.2)
    assert np.abs(error).max() < 0.01


@pytest.mark.parametrize("H", [translation(-15.4, 9.7), translation(20.3, 22.2), similarity(1.0, 1.01, 18, -12),
                               similarity(-1.0, 0.99, 0, 25)])
def test_large_motion_is_found_at_most_places_that_stay_in_the_picture(H: Homography) -> None:
    motion = apply(np.linalg.inv(H), CENTRES.astype(float)) - CENTRES
    visible = np.all((CENTRES + motion >= 32) & (CENTRES + motion <= np.array(SIZE) - 32), axis=1)
    shifts = correlator(1.0).shifts(picture(H, noise=1.0))
    found = np.isfinite(shifts[:, 0])
    assert found[visible].mean() > 0.8
    assert np.abs(shifts - motion)[found].max() < 0.15
    assert not found[~np.all((CENTRES + motion >= 31) & (CENTRES + motion <= np.array(SIZE) - 31), axis=1)].any()


def test_where_there_is_nothing_to_find_is_nan() -> None:
    for other in (random_noise(), moved(0, 0, seed=2), flat(), flat(noise=0.0), np.zeros_like(REFERENCE)):
        assert np.isnan(correlator().shifts(other)).all()
        assert np.isnan(Correlator(other, CENTRES).shifts(REFERENCE)).all()
    assert np.isnan(Correlator(flat(noise=0.0), CENTRES).shifts(flat(noise=0.0))).all()
    assert np.isnan(Correlator(flat(90), CENTRES).shifts(flat(91))).all(), "noise that differs"


@pytest.mark.parametrize("wave", [
    lambda x, y: np.tanh((0.92 * x + 0.39 * y - 200) / 1.5),  # an edge: no telling how far along it has moved
    lambda x, y: np.sin((0.92 * x + 0.39 * y) / 3),  # stripes
    lambda x, y: np.sin(x / 2) * np.sin(y / 2),  # a lattice: moved by one mesh it looks the same
], ids=["edge", "stripes", "lattice"])
def test_what_fits_in_many_places_is_nan(wave: Callable[[FloatArray, FloatArray], FloatArray]) -> None:
    y, x = np.mgrid[: SIZE[1], : SIZE[0]]
    noise = np.random.default_rng(4).normal(128, 1, (2, *REFERENCE.shape))
    reference, current = np.asarray(np.clip(np.round(noise + 60 * wave(x, y)), 0, 255), np.uint8)
    assert np.isnan(Correlator(reference, CENTRES).shifts(current)).all()


def test_only_usable_areas_are_looked_for_and_none_depends_on_another() -> None:
    current = moved(1.2, 0.7, noise=1.0)
    together, usable = correlator().shifts(current), np.arange(len(CENTRES)) % 3 == 0
    some = correlator().shifts(current, usable)
    np.testing.assert_array_equal(some[usable], together[usable])
    assert np.isnan(some[~usable]).all()
    np.testing.assert_array_equal(Correlator(REFERENCE, CENTRES[:1]).shifts(current), together[:1])
    np.testing.assert_array_equal(correlator().shifts(current), together)


def test_areas_cut_by_the_invalid_part_are_nan_where_they_were_and_where_they_are() -> None:
    current, valid = moved(12.0, 0.0), np.ones(REFERENCE.shape, bool)
    valid[:, 300:] = False
    shifts = correlator().shifts(current, valid=valid)
    inside = CENTRES[:, 0] + 12 + 32 <= 300
    np.testing.assert_array_equal(np.isfinite(shifts[:, 0]), inside)
    assert (CENTRES[~inside, 0] + 32 <= 300).any(), "one that is cut only where it has moved to"
    valid = np.ones(REFERENCE.shape, bool)
    valid[0:140, 80] = False
    shifts = correlator().shifts(moved(-12.0, 0.0), valid=valid)
    cut = [np.any(~valid[y - 32 : y + 32, x - 32 + dx : x + 32 + dx]) for x, y in CENTRES for dx in (0, -12)]
    np.testing.assert_array_equal(np.isnan(shifts[:, 0]), np.reshape(cut, (-1, 2)).any(axis=1))


def test_black_border_beside_an_area_would_have_been_measured() -> None:
    """The mask matters: without it an area half black gives a wrong shift, or none."""
    current, valid = moved(0.0, 0.0), np.ones(REFERENCE.shape, bool)
    current[:, :48], valid[:, :48] = 0, False
    assert np.isfinite(correlator().shifts(current, valid=valid)[:, 0]).sum() == (CENTRES[:, 0] - 32 >= 48).sum()


def test_areas_at_the_border_are_moved_inwards() -> None:
    corners = np.array([[0, 0], [20, 150], [399, 299], [200, 290]])
    wanderer = Correlator(REFERENCE, corners)
    assert wanderer.areas_px.tolist() == [[40, 40], [40, 150], [360, 260], [200, 260]]
    error = wanderer.shifts(moved(2.3, 1.8)) - (2.3, 1.8)
    assert np.abs(error).max() < 0.005
    assert np.isnan(wanderer.shifts(moved(-30.0, -30.0))[0]).all(), "what has left the picture"


def test_small_pictures_have_small_areas_or_none() -> None:
    size = (60, 48)
    small = Correlator(picture(size=size, noise=0), np.array([[30, 24]]))
    assert small.window_px == 32
    assert small.shifts(picture(translation(-0.4, 0.3), size, noise=0))[0] == pytest.approx([0.4, -0.3], abs=0.01)
    tiny = Correlator(REFERENCE[:20, :30], np.array([[10, 10], [5, 5]]))
    assert np.isnan(tiny.shifts(REFERENCE[:20, :30])).all()
    assert Correlator(REFERENCE, np.empty((0, 2), np.int64)).shifts(REFERENCE).shape == (0, 2)


def test_misuse_is_an_error() -> None:
    with pytest.raises(ValueError, match="must be even"):
        Correlator(REFERENCE, CENTRES, 31)
    with pytest.raises(ValueError, match=r"must be \(n, 2\)"):
        Correlator(REFERENCE, CENTRES[:, 0])
    with pytest.raises(ValueError, match="uint8"):
        Correlator(np.zeros((300, 400, 3), np.uint8), CENTRES)
    with pytest.raises(ValueError, match="as the reference"):
        correlator().shifts(REFERENCE[1:])
    with pytest.raises(ValueError, match="as the reference"):
        correlator().shifts(REFERENCE, valid=np.ones((3, 3), bool))


@pytest.mark.parametrize("name", ["IMG_9354.jpg", "DJI_0025.JPG"])
def test_photographs(shared_data: Path, name: str) -> None:
    """As a camera with ten times fewer pixels sees a real photograph, moved by whole pixels of it."""
    still = np.asarray(cv2.imread(str(shared_data / "stills" / name), cv2.IMREAD_GRAYSCALE))
    centres = np.stack(np.meshgrid(np.arange(48, 340, 48), np.arange(48, 170, 40)), axis=-1).reshape(-1, 2)
    photograph = Correlator(shrunk(still, 0, 0), centres)
    for u, v in ((1, 0), (2, -1), (-3, 4), (5, 0), (20, -20), (32, 24)):
        error = photograph.shifts(shrunk(still, u, v)) - np.array([u, v]) / 10
        assert np.isfinite(error[:, 0]).mean() > 0.9
        assert np.nanmax(np.abs(error)) < 0.05
        assert np.abs(np.nanmean(error, axis=0)).max() < 0.005


def shrunk(still: Gray, u: int, v: int) -> Gray:
    """Means of blocks of 10x10, content moved by u/10 and v/10 px."""
    rows, columns = (still.shape[0] - 100) // 10, (still.shape[1] - 100) // 10
    part = still[50 - v : 50 - v + 10 * rows, 50 - u : 50 - u + 10 * columns]
    return np.asarray(np.round(part.reshape(rows, 10, columns, 10).mean(axis=(1, 3))), np.uint8)
