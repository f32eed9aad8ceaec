"""Homography and displacements of the rows, fitted together: against waves that are known, and where there are none."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stab_ros.core.geometry import apply, rms_distance, shift
from stab_ros.core.row_shifts import RowShifts, spline_weights
from stab_ros.core.types import Correspondences, FloatArray
from stab_ros.estimation.rows import (
    RowFit,
    changing_share,
    fit_rows,
    independent_share,
    residuals_by_rows,
    straightened,
)

SIZE = (960, 540)
TRUTH = np.array([[1.004, 0.006, 4.0], [-0.005, 0.998, -3.0], [4e-6, -3e-6, 1.0]])
NOISE_PX = 0.05


def swing(rows_px: FloatArray, along_px: tuple[float, float], cycles: float, phase: float = 0.6) -> FloatArray:
    """(n, 2): a wave along x, and another one along y."""
    turn = 2 * np.pi * (rows_px / SIZE[1] * cycles + phase)
    return np.stack([along_px[0] * np.sin(turn), along_px[1] * np.cos(0.8 * turn)], axis=1)


def pairs_of(current_px: FloatArray, moved_px: FloatArray, seed: int) -> Correspondences:
    """Features at current_px that belong at current_px + moved_px, with noise."""
    noise = np.random.default_rng([seed, 1]).normal(0, NOISE_PX, current_px.shape)
    n = len(current_px)
    return Correspondences(np.arange(n), apply(TRUTH, current_px + moved_px) + noise, current_px,
                           np.tile(np.eye(2) / NOISE_PX**2, (n, 1, 1)))


def places(n: int = 1500, seed: int = 0) -> FloatArray:
    return np.random.default_rng(seed).uniform((10, 10), (SIZE[0] - 10, SIZE[1] - 10), (n, 2))


def fitted(pairs: Correspondences) -> RowFit:
    """From a place that is 1 px off, and again from there, as a frame is measured again."""
    trust = np.ones(len(pairs))
    found = fit_rows(pairs, trust, "projective", 0.5, shift(0.8, -0.6) @ TRUTH, SIZE)
    assert found is not None
    found = fit_rows(pairs, trust, "projective", 0.5, found.fit.ref_H_cur, SIZE, found.fit.rows)
    assert found is not None
    return found


def left_px(found: RowFit, along_px: tuple[float, float], cycles: float) -> float:
    """RMS of what the fit leaves at any place of the frame."""
    at_px = places(4000, 9)
    truth = apply(TRUTH, at_px + swing(at_px[:, 1], along_px, cycles))
    assert found.fit.rows is not None
    made = apply(found.fit.ref_H_cur, at_px + found.fit.rows.at(at_px[:, 1]))
    return float(np.sqrt(((made - truth) ** 2).sum(axis=1).mean()))


@pytest.mark.parametrize("cycles", [1.0, 2.3, 5.0, 8.0])
@pytest.mark.parametrize("along_px", [(0.5, 0.0), (0.3, 0.6), (1.5, 1.0)])
def test_waves_are_found_along_both_axes(along_px: tuple[float, float], cycles: float) -> None:
    at_px = places()
    found = fitted(pairs_of(at_px, swing(at_px[:, 1], along_px, cycles), 2))
    assert found.holds
    assert min(found.across, found.between) > 0.9
    assert left_px(found, along_px, cycles) < 0.04 + 0.02 * max(along_px)


def test_a_third_of_outliers_changes_little() -> None:
    at_px, rng = places(), np.random.default_rng(5)
    moved = swing(at_px[:, 1], (0.5, 0.3), 4.0)
    moved[::3] += rng.uniform(-8, 8, moved[::3].shape)
    found = fitted(pairs_of(at_px, moved, 3))
    assert found.holds
    assert left_px(found, (0.5, 0.3), 4.0) < 0.05
    assert found.fit.inlier[::3].mean() < 0.1
    assert np.delete(found.fit.inlier, np.s_[::3]).mean() > 0.9


def test_the_homography_is_the_best_plane_even_between_two_banks() -> None:
    """No feature in the middle third: the wave goes on there, and does not tilt the plane."""
    at_px = places(3000)
    at_px = at_px[np.abs(at_px[:, 1] - SIZE[1] / 2) > SIZE[1] / 6]
    found = fitted(pairs_of(at_px, swing(at_px[:, 1], (0.5, 0.0), 5.0), 4))
    assert rms_distance(found.fit.ref_H_cur, TRUTH, SIZE) < 0.05
    assert left_px(found, (0.5, 0.0), 5.0) < 0.1


@pytest.mark.parametrize("seed", range(5))
def test_noise_alone_shows_no_rows(seed: int) -> None:
    at_px = places(800, seed)
    found = fitted(pairs_of(at_px, np.zeros_like(at_px), seed))
    assert not found.holds
    assert max(found.across, found.between) < 0.05


@pytest.mark.parametrize("size_px", [0.3, 1.0])
def test_what_differs_along_the_rows_does_not_hold(size_px: float) -> None:
    """A bank at the right that stands above the plane, and a bump in the middle of it."""
    at_px = places()
    moved = np.zeros_like(at_px)
    moved[:, 0] = size_px * ((at_px[:, 0] > 600) & (at_px[:, 1] > 200))
    moved[:, 1] = size_px * np.exp(-np.sum((at_px - [300, 150]) ** 2, axis=1) / 80**2)
    assert not fitted(pairs_of(at_px, moved, 6)).holds


def test_too_few_features_determine_nothing() -> None:
    at_px = places(40)
    pairs = pairs_of(at_px, swing(at_px[:, 1], (0.5, 0.0), 3.0), 7)
    assert fit_rows(pairs, np.ones(40), "projective", 0.5, np.eye(3), SIZE) is None
    nothing_trusted = fit_rows(pairs_of(places(), places() * 0, 1), np.zeros(1500), "projective", 0.5, np.eye(3), SIZE)
    assert nothing_trusted is None


def test_the_first_look_sees_what_both_halves_share() -> None:
    at_px = places()
    still, moved = (pairs_of(at_px, swing(at_px[:, 1], (a, 0.0), 5.0), 8) for a in (0.0, 0.2))
    seen = [residuals_by_rows(pairs, np.ones(1500), TRUTH, SIZE) for pairs in (still, moved)]
    assert [one.show for one in seen] == [False, True]
    assert seen[1].shared == pytest.approx(0.2**2 / 2, rel=0.15)
    untrusted = residuals_by_rows(moved, np.zeros(1500), TRUTH, SIZE)
    assert (untrusted.shared, np.abs(untrusted.halves).max()) == (0.0, 0.0)


def curves(weights: FloatArray, shapes: FloatArray, seed: int) -> list[FloatArray]:
    """Two measurements (F, 32, 2) of curves made of shapes (n, 32) by weights (F, 2, n)."""
    exact = np.einsum("fdn,nb->fbd", weights, shapes)
    return [exact + np.random.default_rng([seed, k]).normal(0, 0.02, exact.shape) for k in range(2)]


def test_relief_and_water_are_one_shape_that_changes_slowly_and_waves_are_not() -> None:
    frame, band = np.arange(12.0), np.linspace(0, 1, 32)
    sway = np.stack([np.sin(frame / 4), np.cos(frame / 4)], axis=1)[..., None]
    bank = curves(sway, np.where(band < 0.3, 0.5, 0.0)[None], 1)
    water = curves(np.stack([frame, 0 * frame], axis=1)[..., None] / 12, np.exp(-((band - 0.5) ** 2) / 0.02)[None], 2)
    turn = 2 * np.pi * 0.37 * frame
    phases = np.stack([np.stack([np.cos(turn), np.sin(turn)], 1), np.zeros((12, 2))], axis=1)
    wave = curves(phases, np.stack([np.sin(2 * np.pi * 5 * band), np.cos(2 * np.pi * 5 * band)]), 3)
    assert max(independent_share(*bank), independent_share(*water)) < 0.1
    assert max(changing_share(*bank), changing_share(*water)) < 0.2
    assert independent_share(*wave) > 0.4
    assert changing_share(*wave) > 1.0
    nothing = np.zeros((12, 32, 2))
    assert independent_share(nothing, nothing) == changing_share(nothing, nothing) == 0.0


@given(st.integers(4, 40), st.integers(64, 2000), st.integers(0, 1000))
def test_a_curve_is_undone_where_rows_keep_their_order(count: int, height: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    rows = RowShifts(rng.normal(0, 0.1 * height / count, (count, 2)).clip(-0.2 * height / count, None), height)
    at_px = rng.uniform(0, height - 1, (50, 2))
    shown = rows.before(at_px)
    np.testing.assert_allclose(shown + rows.at(shown[:, 1]), at_px, atol=0.02)


def test_splines_are_those_of_de_boor() -> None:
    """The weights sum to 1, reproduce straight lines, and have the known values at a knot and between two."""
    y = np.linspace(0, 99, 400)
    first, weights = spline_weights(y, 13, 100)
    np.testing.assert_allclose(weights.sum(axis=1), 1.0)
    line = ((first[:, None] + np.arange(4) - 1) * weights).sum(axis=1)
    np.testing.assert_allclose(line, y / 9.9, atol=1e-12)
    _, known = spline_weights(np.array([0.0, 4.95]), 13, 100)
    np.testing.assert_allclose(known, [[1 / 6, 4 / 6, 1 / 6, 0], [1 / 48, 23 / 48, 23 / 48, 1 / 48]], atol=1e-12)


def test_rows_beyond_the_frame_move_as_its_edges() -> None:
    rows = RowShifts(np.random.default_rng(3).normal(0, 1, (8, 2)), 100)
    np.testing.assert_array_equal(rows.at(np.array([-50.0, 500.0])), rows.at(np.array([0.0, 99.0])))
    assert rows.rms_px == pytest.approx(float(np.sqrt((rows.values**2).sum(axis=1).mean())))
    assert rows.most_px == pytest.approx(float(np.hypot(*rows.values.T).max()))


@pytest.mark.parametrize("coefficients", [np.zeros((3, 2)), np.zeros((8, 3)), np.zeros(8), np.full((8, 2), np.nan)])
def test_a_curve_of_another_shape_is_refused(coefficients: FloatArray) -> None:
    with pytest.raises(ValueError, match="coefficients"):
        RowShifts(coefficients, 100)


def test_straightened_features_lie_on_the_plane() -> None:
    at_px = places(100)
    rows = RowShifts(np.random.default_rng(3).normal(0, 1, (8, 2)), SIZE[1])
    pairs = pairs_of(at_px, rows.at(at_px[:, 1]), 1)
    off = apply(TRUTH, straightened(pairs, rows).current_px) - pairs.reference_px
    assert np.abs(off).max() < 6 * NOISE_PX
    assert straightened(pairs, None) is pairs
