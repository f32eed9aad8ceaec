"""Rating curves of known rivers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stab_ros.core.errors import InputError
from stab_ros.discharge.rating import Gauging, fit_rating

STAGES = np.linspace(0.785, 1.762, 14)  # of the Feshie in Perks et al. 2020


def true_q(stage: np.ndarray) -> np.ndarray:
    return np.asarray(30 * (stage - 0.2) ** 1.9)


def gaugings(seed: int | None = None, own: float = 0.03, shared: float = 0.05) -> list[Gauging]:
    rng = np.random.default_rng(seed)
    common = 0.0 if seed is None else rng.normal(0, shared)
    noise = np.zeros(len(STAGES)) if seed is None else rng.normal(0, own, len(STAGES))
    q = true_q(STAGES) * np.exp(common + noise)
    return [Gauging(h, one, one * float(np.hypot(own, shared)), shared) for h, one in zip(STAGES, q, strict=True)]


def test_exact_without_noise() -> None:
    rating = fit_rating(gaugings())
    assert (rating.a, rating.b, rating.h0_m) == pytest.approx((30, 1.9, 0.2), rel=1e-6)
    assert rating.at(np.array([0.1, 1.0]))[0] == pytest.approx([0, float(true_q(np.array(1.0)))])


def test_the_truth_lies_within_the_interval() -> None:
    at = np.array([0.6, 1.2, 2.0])
    within = []
    for seed in range(100):
        q, sigma = fit_rating(gaugings(seed)).at(at)
        within.append(np.abs(np.log(q / true_q(at))) < 1.96 * sigma)
    assert (np.mean(within, axis=0) > 0.88).all()


def test_a_known_stage_of_no_flow_is_kept() -> None:
    rating = fit_rating(gaugings(1)[:2], 0.2)
    assert rating.h0_m == 0.2
    assert rating.covariance[2, 2] == 0


def test_gaugings_without_sigma_count_alike_and_are_said() -> None:
    rating = fit_rating([Gauging(one.stage_m, one.q_m3_s) for one in gaugings(3)])
    assert any("count alike" in warning for warning in rating.warnings)
    assert rating.at(np.array(1.2))[1] > 0


def test_more_scatter_than_said_is_said() -> None:
    rating = fit_rating([Gauging(one.stage_m, one.q_m3_s, 0.003 * one.q_m3_s) for one in gaugings(3)])
    assert rating.scatter > 3
    assert any("scatter" in warning for warning in rating.warnings)


@pytest.mark.parametrize("column", [False, True])
def test_large_rivers_whose_error_is_almost_all_alpha(column: bool) -> None:
    """Totals of a Monte Carlo of alpha alone lie on both sides of the shared part; what they leave tells nothing."""
    rng, shared = np.random.default_rng(5), 0.04 / 0.85
    total = shared * rng.normal(1, 1 / np.sqrt(2 * 1000), len(STAGES))  # standard deviations of 1000 draws
    q = true_q(STAGES) * np.exp(rng.normal(0, 0.004, len(STAGES)))
    own = 0.004 if column else None
    rating = fit_rating([Gauging(h, one, one * s, shared, "", own) for h, one, s in zip(STAGES, q, total, strict=True)])
    at = np.array([0.8, 1.2, 1.7])
    assert (np.abs(np.log(rating.at(at)[0] / true_q(at))) < 0.01).all()
    assert rating.scatter < 1
    assert not rating.warnings


def test_own_parts_weigh_the_gaugings() -> None:
    """Two gaugings off by a factor, with a large error of their own, which their total and shared part do not tell."""
    exact = gaugings()
    wrong = [Gauging(one.stage_m, 1.3 * one.q_m3_s, 0.05 * one.q_m3_s, 0.05, "", 0.5) for one in exact[3:5]]
    rating = fit_rating([*exact[:3], *wrong, *exact[5:]])
    assert rating.at(np.array(1.2))[0] == pytest.approx(float(true_q(np.array(1.2))), rel=0.002)


def test_no_gauging_counts_as_better_than_one_per_cent() -> None:
    fine = [Gauging(one.stage_m, one.q_m3_s, 1e-6 * one.q_m3_s) for one in gaugings(3)]
    coarse = [Gauging(one.stage_m, one.q_m3_s, 0.01 * one.q_m3_s) for one in fine]
    assert fit_rating(fine).scatter == pytest.approx(fit_rating(coarse).scatter)
    assert fit_rating(fine).covariance == pytest.approx(fit_rating(coarse).covariance)


@pytest.mark.parametrize("h0_m", [None, 0.2])
def test_what_some_gaugings_share_moves_the_curve_as_it_moves_them(h0_m: float | None) -> None:
    """Against the fit to gaugings that err by one standard deviation of it."""
    at = np.array([0.9, 1.3, 2.5])
    for own, common in ((0.01, np.full(len(STAGES), 0.05)), (0.01, np.where(STAGES > 1.2, 0.001, 0.0))):
        exact = [Gauging(h, float(true_q(h)), 0.0, one, "", own) for h, one in zip(STAGES, common, strict=True)]
        moved = [replace(one, q_m3_s=one.q_m3_s * float(np.exp(one.shared_sigma))) for one in exact]
        rating, (q, sigma) = fit_rating(exact, h0_m), fit_rating(exact, h0_m).at(at)
        by_own = replace(rating, shared=np.zeros(3)).at(at)[1]
        error = np.log(fit_rating(moved, h0_m).at(at)[0] / q)
        assert np.sqrt(sigma**2 - by_own**2) == pytest.approx(np.abs(error), rel=0.02, abs=1e-6)


def test_too_few_stages() -> None:
    with pytest.raises(InputError, match="2 different stages"):
        fit_rating(gaugings()[:2])
    with pytest.raises(InputError, match="above the stage of no flow"):
        fit_rating(gaugings(), 0.9)
    with pytest.raises(InputError, match="above 0"):
        Gauging(1.0, -3.0)
    with pytest.raises(InputError, match="no sigma below 0"):
        Gauging(1.0, 3.0, own_sigma=-0.1)
