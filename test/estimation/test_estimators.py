"""Every estimator with every model: exact data, outliers, too little, honest uncertainty, independent oracles."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from truth import IDENTITY, SIZE, projective, similarity, translation

from stab_ros.core.geometry import apply, grid, jacobian, rms_distance, sigma_px
from stab_ros.core.types import Correspondences, Fit, FloatArray, Homography
from stab_ros.estimation.estimators import ESTIMATORS, fit
from stab_ros.estimation.models import MODELS, minimal_points

ROBUST = [name for name in ESTIMATORS if name not in ("least_squares", "three_sigma")]  # among many outliers
# the others go by plain distances, or through points of which each is taken to be right
EDGE_WISE = ["least_squares", "lo_ransac", "three_sigma", "magsac"]
TRUTH: dict[str, Homography] = {
    "translation": translation(3.2, -1.7),
    "rigid": similarity(1.3, 1.0, 3.0, -2.0),
    "similarity": similarity(1.3, 1.01, 3.0, -2.0),
    "affine": np.array([[1.014, -0.020, 6.0], [0.023, 1.006, -5.5], [0, 0, 1]]),
    "projective": projective(),
}
THRESHOLD_PX = 0.5
every_estimator = pytest.mark.parametrize("estimator", list(ESTIMATORS))
every_robust = pytest.mark.parametrize("estimator", ROBUST)
every_model = pytest.mark.parametrize("model", list(MODELS))
simplest_and_largest = pytest.mark.parametrize("model", [  # of which the other models lie in between
    model if model in ("translation", "projective") else pytest.param(model, marks=pytest.mark.thorough)
    for model in MODELS])


def points(n: int, seed: int = 1) -> FloatArray:
    return np.asarray(np.random.default_rng(seed).uniform(0, 1, (n, 2)) * (np.array(SIZE) - 1))


def pairs_of(reference_px: FloatArray, current_px: FloatArray, information: FloatArray | None = None,
             sigma: float = 0.05) -> Correspondences:
    n = len(current_px)
    certain = np.tile(np.eye(2) / sigma**2, (n, 1, 1)) if information is None else information
    return Correspondences(np.arange(n), reference_px, current_px, certain)


def noisy(H: Homography, current_px: FloatArray, sigma: float, seed: int) -> FloatArray:
    return apply(H, current_px) + np.random.default_rng(seed).normal(0, sigma, current_px.shape)


def found(result: Fit | None) -> Fit:
    assert result is not None
    return result


@every_estimator
@every_model
@pytest.mark.parametrize("more", [0, 1, 2, 200])
def test_exact_data_give_the_exact_homography(model: str, estimator: str, more: int) -> None:
    current = points(minimal_points(model) + more)
    fitted = found(fit(pairs_of(apply(TRUTH[model], current), current), model, estimator, THRESHOLD_PX, IDENTITY))
    assert rms_distance(fitted.ref_H_cur, TRUTH[model], SIZE) < 1e-4
    assert fitted.inlier.all()
    assert fitted.rmse_px < 1e-4
    assert fitted.ref_H_cur[2, 2] == 1


@every_estimator
@every_model
def test_result_stays_in_the_model(model: str, estimator: str) -> None:
    current = points(100)
    pairs = pairs_of(noisy(TRUTH[model], current, 0.3, 2), current, sigma=0.3)
    H = found(fit(pairs, model, estimator, 1.0, projective())).ref_H_cur
    if model != "projective":
        np.testing.assert_allclose(H[2], [0, 0, 1], atol=1e-12)
    if model in ("translation", "rigid", "similarity"):
        assert H[0, 0] == pytest.approx(H[1, 1], abs=1e-12)
        assert H[0, 1] == pytest.approx(-H[1, 0], abs=1e-12)
    if model == "rigid":
        assert np.hypot(H[0, 0], H[1, 0]) == pytest.approx(1, abs=1e-12)
    if model == "translation":
        np.testing.assert_allclose(H[:2, :2], np.eye(2), atol=1e-12)


@every_robust
@every_model
@pytest.mark.parametrize("kind", ["scattered", "moving together"])
def test_forty_percent_of_outliers_do_no_harm(model: str, estimator: str, kind: str) -> None:
    rng = np.random.default_rng(8)
    current = points(300)
    reference = noisy(TRUTH[model], current, 0.05, 3)
    wrong = np.arange(300) < 120
    reference[wrong] += rng.uniform(-40, 40, (120, 2)) if kind == "scattered" else np.array([5.0, 2.0])
    pairs = pairs_of(reference, current)
    fitted = found(fit(pairs, model, estimator, THRESHOLD_PX, IDENTITY, ransac_threshold_px=1.0))  # 5 px tells apart
    assert rms_distance(fitted.ref_H_cur, TRUTH[model], SIZE) < 0.05
    assert fitted.inlier[~wrong].mean() > 0.95
    assert fitted.inlier[wrong].mean() < 0.02


@every_model
def test_least_squares_believes_outliers(model: str) -> None:
    current = points(100)
    reference = apply(TRUTH[model], current)
    reference[:40] += [5.0, 2.0]
    fitted = found(fit(pairs_of(reference, current), model, "least_squares", 10.0, IDENTITY))
    assert rms_distance(fitted.ref_H_cur, TRUTH[model], SIZE) > 1


@every_estimator
@every_model
def test_too_few_points_give_nothing(model: str, estimator: str) -> None:
    for n in range(minimal_points(model)):
        current = points(n)
        assert fit(pairs_of(current + 1, current), model, estimator, THRESHOLD_PX, IDENTITY) is None


@every_estimator
@pytest.mark.parametrize(("model", "kind"), [
    ("rigid", "coincident"), ("similarity", "coincident"), ("affine", "coincident"), ("affine", "collinear"),
    ("projective", "coincident"), ("projective", "collinear"), ("projective", "collinear but one"),
])
@pytest.mark.parametrize("n", [4, 5, 50])
def test_degenerate_points_give_nothing(model: str, kind: str, n: int, estimator: str) -> None:
    current = points(n)
    if kind == "coincident":
        current[:] = current[0]
    else:
        line = slice(kind == "collinear but one", None)
        current[line, 1] = 0.5 * current[line, 0] + 20
    assert fit(pairs_of(current + 1.5, current), model, estimator, THRESHOLD_PX, IDENTITY) is None


@every_estimator
def test_features_nobody_trusts_give_nothing(estimator: str) -> None:
    current = points(50)
    pairs = pairs_of(current + 1, current)
    assert fit(pairs, "projective", estimator, THRESHOLD_PX, IDENTITY, np.zeros(50)) is None


@every_robust
def test_trust_decides_between_two_planes(estimator: str) -> None:
    current = points(200)
    water = np.arange(200) < 120  # the majority
    reference = noisy(projective(), current, 0.02, 4)
    reference[water] += [4.0, 1.0]
    trust = np.where(water, 0.05, 1.0)
    pairs = pairs_of(reference, current, sigma=0.02)
    fitted = found(fit(pairs, "projective", estimator, THRESHOLD_PX, IDENTITY, trust))
    assert rms_distance(fitted.ref_H_cur, projective(), SIZE) < 0.05


@every_estimator
def test_the_same_twice(estimator: str) -> None:
    current = points(100)
    reference = noisy(projective(), current, 0.05, 6)
    reference[:50] += np.random.default_rng(7).uniform(-20, 20, (50, 2))
    first, second = (found(fit(pairs_of(reference, current), "projective", estimator, THRESHOLD_PX, IDENTITY))
                     for _ in range(2))
    np.testing.assert_array_equal(first.ref_H_cur, second.ref_H_cur)
    np.testing.assert_array_equal(first.covariance, second.covariance)


@every_estimator
def test_input_is_not_modified(estimator: str) -> None:
    current = points(100)
    pairs, trust = pairs_of(noisy(projective(), current, 0.1, 5), current), np.linspace(0, 1, 100)
    arrays = [pairs.reference_px, pairs.current_px, pairs.information, trust]
    before = [array.copy() for array in arrays]
    fit(pairs, "projective", estimator, THRESHOLD_PX, IDENTITY, trust)
    for array, copy in zip(arrays, before, strict=True):
        np.testing.assert_array_equal(array, copy)


# --- oracles -------------------------------------------------------------------------------------------------------


def test_least_squares_translation_is_the_mean() -> None:
    current = points(60)
    reference = noisy(translation(2, 1), current, 0.2, 9)
    H = found(fit(pairs_of(reference, current), "translation", "least_squares", THRESHOLD_PX, IDENTITY)).ref_H_cur
    np.testing.assert_allclose(H[:2, 2], (reference - current).mean(axis=0), atol=1e-6)


def test_least_squares_affine_is_numpy_s() -> None:
    current = points(60)
    reference = noisy(TRUTH["affine"], current, 0.2, 10)
    expected = np.linalg.lstsq(np.column_stack([current, np.ones(60)]), reference, rcond=None)[0].T
    H = found(fit(pairs_of(reference, current), "affine", "least_squares", THRESHOLD_PX, IDENTITY)).ref_H_cur
    np.testing.assert_allclose(apply(H, grid(SIZE)), grid(SIZE) @ expected[:, :2].T + expected[:, 2], atol=1e-6)


def test_least_squares_similarity_is_numpy_s() -> None:
    current = points(60)
    reference = noisy(TRUTH["similarity"], current, 0.2, 12)
    (x, y), one, zero = current.T, np.ones(60), np.zeros(60)
    rows = np.concatenate([np.column_stack([x, -y, one, zero]), np.column_stack([y, x, zero, one])])
    a, b, tx, ty = np.linalg.lstsq(rows, reference.T.ravel(), rcond=None)[0]
    H = found(fit(pairs_of(reference, current), "similarity", "least_squares", THRESHOLD_PX, IDENTITY)).ref_H_cur
    np.testing.assert_allclose(H, [[a, -b, tx], [b, a, ty], [0, 0, 1]], atol=1e-6)


def test_least_squares_homography_is_opencv_s() -> None:
    current = points(60)
    reference = noisy(projective(), current, 0.2, 11)
    expected = cv2.findHomography(current, reference, 0)[0]  # minimises the same reference-side distances
    H = found(fit(pairs_of(reference, current), "projective", "least_squares", THRESHOLD_PX, IDENTITY)).ref_H_cur
    assert rms_distance(H, expected, SIZE) < 1e-3


@every_robust
def test_robust_homography_agrees_with_opencv_s(estimator: str) -> None:
    current = points(400)
    reference = noisy(projective(), current, 0.05, 13)
    reference[:120] += np.random.default_rng(14).uniform(-30, 30, (120, 2))
    expected = cv2.findHomography(current, reference, cv2.RANSAC, THRESHOLD_PX)[0]  # its inliers by least squares
    H = found(fit(pairs_of(reference, current), "projective", estimator, THRESHOLD_PX, IDENTITY)).ref_H_cur
    assert rms_distance(H, expected, SIZE) < 0.03


@pytest.mark.parametrize("estimator", ["ransac", "lo_ransac"])
def test_affine_agrees_with_opencv_s(estimator: str) -> None:
    current = points(200)
    reference = noisy(TRUTH["affine"], current, 0.05, 15)
    reference[:60] += 20
    matrix = cv2.estimateAffine2D(current, reference, method=cv2.RANSAC, ransacReprojThreshold=THRESHOLD_PX)[0]
    H = found(fit(pairs_of(reference, current), "affine", estimator, THRESHOLD_PX, IDENTITY)).ref_H_cur
    assert rms_distance(H, np.vstack([matrix, [0, 0, 1]]), SIZE) < 0.05


# --- what the papers' estimators drop ------------------------------------------------------------------------------


def test_rigid_is_the_closed_form() -> None:
    current = points(60)
    reference = noisy(TRUTH["rigid"], current, 0.2, 23)
    p, q = current - current.mean(axis=0), reference - reference.mean(axis=0)
    u, _, vt = np.linalg.svd(q.T @ p)  # Kabsch 1976
    R = u @ np.diag([1, np.linalg.det(u @ vt)]) @ vt
    H = found(fit(pairs_of(reference, current), "rigid", "least_squares", THRESHOLD_PX, IDENTITY)).ref_H_cur
    np.testing.assert_allclose(H[:2, :2], R, atol=1e-8)
    np.testing.assert_allclose(H[:2, 2], reference.mean(axis=0) - R @ current.mean(axis=0), atol=1e-5)


@every_model
def test_three_sigma_drops_gross_errors_until_none_is_left(model: str) -> None:
    current = points(100)
    reference = noisy(TRUTH[model], current, 0.1, 24)
    reference[:8] += np.random.default_rng(25).choice([-1, 1], (8, 2)) * [[1.0], [2], [4], [8], [16], [32], [64], [128]]
    pairs = pairs_of(reference, current, sigma=0.1)
    fitted = found(fit(pairs, model, "three_sigma", THRESHOLD_PX, IDENTITY))
    assert not fitted.inlier[:8].any()  # the large ones hide the small ones at first
    clean = found(fit(pairs[fitted.inlier], model, "least_squares", 10.0, IDENTITY))
    assert rms_distance(fitted.ref_H_cur, clean.ref_H_cur, SIZE) < 0.01
    distance = np.linalg.norm(reference - apply(fitted.ref_H_cur, current), axis=1)
    deviation = np.sqrt(np.sum(distance[fitted.inlier] ** 2) / (fitted.inlier.sum() - 1))
    assert distance[fitted.inlier].max() <= 3 * deviation + 1e-6


def test_three_sigma_cannot_judge_ten_points() -> None:
    """The largest of n residuals is at most sqrt(n - 1) standard deviations."""
    current = points(10)
    reference = current.copy()
    reference[0] += 100.0
    assert found(fit(pairs_of(reference, current), "translation", "three_sigma", THRESHOLD_PX, IDENTITY)).inlier.all()


@every_model
def test_lmeds_needs_no_threshold(model: str) -> None:
    current = points(300)
    reference = noisy(TRUTH[model], current, 0.05, 26)
    reference[:120] += np.random.default_rng(27).uniform(-40, 40, (120, 2))
    first, second = (found(fit(pairs_of(reference, current), model, "lmeds", threshold_px, IDENTITY))
                     for threshold_px in (0.01, 20.0))
    np.testing.assert_array_equal(first.inlier, second.inlier)
    assert rms_distance(first.ref_H_cur, second.ref_H_cur, SIZE) < 1e-3


def test_ed_ransac_retains_what_is_near_by_plain_distance() -> None:
    current = points(2000)
    reference = noisy(projective(), current, 0.4, 28)
    reference[:500] += np.random.default_rng(29).uniform(10, 40, (500, 2))
    pairs = pairs_of(reference, current, sigma=5.0)  # what a feature claims does not matter
    fitted = found(fit(pairs, "projective", "ed_ransac", 0.2, IDENTITY))
    assert fitted.consensus is not None
    assert 0.98 < fitted.consensus / 1500 <= 1.0
    assert not fitted.inlier[:500].any()
    assert fitted.inlier.sum() / fitted.consensus == pytest.approx(1 - np.exp(-(0.2**2) / (2 * 0.4**2)), rel=0.15)
    # Zhang's tables 2 and 4: points that fill a disc of 0.2 px have an RMSE of 0.2 / sqrt(2) px in any case
    assert fitted.rmse_px == pytest.approx(0.2 / np.sqrt(2), rel=0.05)
    assert rms_distance(fitted.ref_H_cur, projective(), SIZE) < 0.1


def test_ed_ransac_takes_its_consensus_with_its_own_threshold() -> None:
    current = points(400)
    reference = noisy(projective(), current, 0.02, 30)
    reference[:100] += 1.5
    narrow, wide = (found(fit(pairs_of(reference, current), "projective", "ed_ransac", 0.5, IDENTITY,
                              ransac_threshold_px=ransac_threshold_px)) for ransac_threshold_px in (0.5, 8.0))
    assert (narrow.consensus, wide.consensus) == (300, 400)


def test_only_ransac_has_a_consensus() -> None:
    current = points(50)
    pairs = pairs_of(noisy(projective(), current, 0.05, 31), current)
    for estimator in ESTIMATORS:
        fitted = found(fit(pairs, "projective", estimator, THRESHOLD_PX, IDENTITY))
        assert (fitted.consensus is not None) == (estimator in ("ransac", "ed_ransac"))


# --- information and covariance ------------------------------------------------------------------------------------


def edges(n: int, along_px: float, across_px: float, seed: int) -> FloatArray:
    """Covariances (n, 2, 2) of features on edges of every direction."""
    angle = np.random.default_rng(seed).uniform(0, np.pi, n)
    R = np.stack([np.stack([np.cos(angle), -np.sin(angle)], -1), np.stack([np.sin(angle), np.cos(angle)], -1)], -2)
    return np.asarray(R @ np.diag([along_px**2, across_px**2]) @ R.transpose(0, 2, 1))


@pytest.mark.parametrize("estimator", EDGE_WISE)
def test_an_edge_says_nothing_along_itself(estimator: str) -> None:
    current, covariance = points(200), edges(200, 50.0, 0.02, 1)
    slid = np.einsum("nij,nj->ni", np.linalg.cholesky(covariance), np.random.default_rng(2).standard_normal((200, 2)))
    reference = apply(projective(), current) + slid  # by 50 px along the edges, by 0.02 px across
    pairs = pairs_of(reference, current, np.linalg.inv(covariance))
    fitted = found(fit(pairs, "projective", estimator, THRESHOLD_PX, IDENTITY))
    assert rms_distance(fitted.ref_H_cur, projective(), SIZE) < 0.02
    assert fitted.inlier.mean() > 0.95


@every_model
def test_least_squares_weighs_by_information(model: str) -> None:
    current = points(100)
    sigma = np.where(np.arange(100) < 50, 0.01, 1.0)
    reference = apply(TRUTH[model], current) + np.random.default_rng(3).standard_normal((100, 2)) * sigma[:, None]
    information = np.eye(2) / sigma[:, None, None] ** 2
    fitted = found(fit(pairs_of(reference, current, information), model, "least_squares", THRESHOLD_PX, IDENTITY))
    assert rms_distance(fitted.ref_H_cur, TRUTH[model], SIZE) < 0.01


def empirical(model: str, estimator: str, covariances: FloatArray, outliers: float,
              threshold_px: float = THRESHOLD_PX) -> tuple[float, float, FloatArray]:
    """Over 200 draws of noise: RMS distance from the truth, median claimed sigma, and the (81,) ratio of the two."""
    truth, current, rng = TRUTH[model], points(len(covariances)), np.random.default_rng(16)
    root, information = np.linalg.cholesky(covariances), np.linalg.inv(covariances)
    error, claim, claims = [], [], []
    for _ in range(200):
        reference = apply(truth, current) + np.einsum("nij,nj->ni", root, rng.standard_normal(current.shape))
        wrong = rng.random(len(current)) < outliers
        reference[wrong] += rng.uniform(-30, 30, (int(wrong.sum()), 2))
        fitted = found(fit(pairs_of(reference, current, information), model, estimator, threshold_px, IDENTITY))
        J = jacobian(fitted.ref_H_cur, grid(SIZE))
        error.append(((apply(fitted.ref_H_cur, grid(SIZE)) - apply(truth, grid(SIZE))) ** 2).sum(axis=1))
        claims.append(np.einsum("nij,jk,nik->n", J, fitted.covariance, J))
        claim.append(sigma_px(fitted.ref_H_cur, fitted.covariance, SIZE))
    ratio = np.sqrt(np.mean(error, axis=0) / np.mean(claims, axis=0))
    return float(np.sqrt(np.mean(error))), float(np.median(claim)), np.asarray(ratio)


@every_estimator
@simplest_and_largest
@pytest.mark.parametrize("features", ["corners", "edges"])
def test_claimed_sigma_is_honest(model: str, estimator: str, features: str) -> None:
    corners = np.tile(np.eye(2) * 0.05**2, (150, 1, 1))
    covariances = corners if features == "corners" else edges(150, 1.0, 0.03, 4)
    scatter_px, claimed_px, ratio = empirical(model, estimator, covariances, outliers=0.0)
    assert 0.8 < scatter_px / claimed_px < 1.2
    assert ratio.max() < 1.3  # also at the corners of the frame, not only on the whole
    assert ratio.min() > 0.7


@every_robust
def test_claimed_sigma_is_honest_among_outliers(estimator: str) -> None:
    share = 0.3 if estimator == "lmeds" else 0.4  # it breaks down at one half, which a few of these draws would have
    scatter_px, claimed_px, _ = empirical("projective", estimator, np.tile(np.eye(2) * 0.05**2, (200, 1, 1)), share)
    assert 0.8 < scatter_px / claimed_px < 1.2


@pytest.mark.parametrize("threshold_px", [0.1, 0.2, 0.4, 0.8, 2.0])
def test_ed_ransac_s_sigma_is_honest_however_much_it_drops(threshold_px: float) -> None:
    covariances = np.tile(np.eye(2) * 0.3**2, (300, 1, 1))
    scatter_px, claimed_px, _ = empirical("affine", "ed_ransac", covariances, 0.0, threshold_px)
    assert 0.75 < scatter_px / claimed_px < 1.25


@every_estimator
def test_sigma_grows_where_features_are_worse_than_they_claim(estimator: str) -> None:
    current = points(300)
    pairs = [pairs_of(noisy(projective(), current, sigma, 17), current, sigma=0.01) for sigma in (0.01, 0.08)]
    honest, boastful = (found(fit(p, "projective", estimator, THRESHOLD_PX, IDENTITY)) for p in pairs)
    claimed = [sigma_px(f.ref_H_cur, f.covariance, SIZE) for f in (honest, boastful)]
    assert claimed[1] > 5 * claimed[0]
    assert rms_distance(boastful.ref_H_cur, projective(), SIZE) < 3 * claimed[1]


@every_estimator
def test_rmse_is_the_distance_of_the_inliers(estimator: str) -> None:
    current = points(200)
    reference = noisy(projective(), current, 0.1, 18)
    fitted = found(fit(pairs_of(reference, current, sigma=0.1), "projective", estimator, THRESHOLD_PX, IDENTITY))
    squared = ((reference - apply(fitted.ref_H_cur, current)) ** 2).sum(axis=1)[fitted.inlier]
    assert fitted.rmse_px == pytest.approx(np.sqrt(squared.mean()))


# --- equivariance --------------------------------------------------------------------------------------------------


@every_estimator
@every_model
@settings(max_examples=15, deadline=None)
@given(x=st.floats(-300, 300), y=st.floats(-300, 300))
def test_shifting_the_reference_shifts_the_homography(model: str, estimator: str, x: float, y: float) -> None:
    current = points(80)
    reference = noisy(TRUTH[model], current, 0.05, 19)
    reference[:20] += 8.0 if estimator in ROBUST else 0.0
    shift = translation(x, y)
    plain, shifted = (
        found(fit(pairs_of(at, current), model, estimator, THRESHOLD_PX, guess)).ref_H_cur
        for at, guess in ((reference, IDENTITY), (apply(shift, reference), shift))
    )
    assert rms_distance(shifted, shift @ plain, SIZE) < 0.005


@every_estimator
@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_the_order_of_the_points_does_not_matter(estimator: str, seed: int) -> None:
    current = points(80)
    reference = noisy(projective(), current, 0.05, 20)
    reference[:20] += 8.0 if estimator in ROBUST else 0.0
    order = np.random.default_rng(seed).permutation(80)
    plain, shuffled = (
        found(fit(pairs_of(reference[at], current[at]), "projective", estimator, THRESHOLD_PX, IDENTITY)).ref_H_cur
        for at in (np.arange(80), order)
    )
    # sigma is 0.03; plain RANSAC keeps the set that its best sample agreed with, which another order changes
    assert rms_distance(plain, shuffled, SIZE) < (0.06 if estimator == "ransac" else 0.02)


@settings(max_examples=30, deadline=None)
@given(degrees=st.floats(-30, 30), scale=st.floats(0.8, 1.25), x=st.floats(-60, 60), y=st.floats(-60, 60))
def test_far_from_the_guess(degrees: float, scale: float, x: float, y: float) -> None:
    truth = similarity(degrees, scale, x, y)
    current = points(200)
    reference = noisy(truth, current, 0.02, 21)
    reference[:60] += np.random.default_rng(22).uniform(-50, 50, (60, 2))
    fitted = found(fit(pairs_of(reference, current, sigma=0.02), "projective", "magsac", THRESHOLD_PX, IDENTITY))
    assert rms_distance(fitted.ref_H_cur, truth, SIZE) < 0.03
