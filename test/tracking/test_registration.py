"""The evidence by which a homography is accepted, and the model that the ground supports."""

from __future__ import annotations

import numpy as np
import pytest
from truth import SIZE

from stab_ros.core.geometry import apply, rms_distance, sigma_px
from stab_ros.core.types import Correspondences, FloatArray, Homography
from stab_ros.tracking.registration import Registration
from stab_ros.tracking.settings import StabilizerConfig
from stab_ros.tracking.support import support_of

TURNED = np.array([[1.0, -0.01, 3.0], [0.01, 1.0, -2.0], [0.0, 0.0, 1.0]])


def matches(reference_px: FloatArray, H: Homography, noise_px: float) -> Correspondences:
    n = len(reference_px)
    noise = np.random.default_rng(3).normal(0, noise_px, (n, 2))
    return Correspondences(np.arange(n), reference_px, apply(np.linalg.inv(H), reference_px + noise),
                           np.tile(np.eye(2) / noise_px**2, (n, 1, 1)))


def places(left: float, right: float, n: int = 200) -> FloatArray:
    draw = np.random.default_rng(4)
    return np.column_stack([draw.uniform(left, right, n), draw.uniform(0, SIZE[1], n)])


@pytest.mark.parametrize(("right", "model"), [(1.0, ""), (0.06, "similarity")])
def test_a_narrow_strip_supports_no_more_than_a_similarity(right: float, model: str) -> None:
    registration = Registration(StabilizerConfig(), SIZE)
    pairs = matches(places(0, right * SIZE[0]), TURNED, 0.15)
    fit = registration.solve(pairs, np.eye(3), np.ones(len(pairs)), np.zeros(len(pairs), bool))
    assert fit is not None
    assert fit.model == model
    assert rms_distance(fit.ref_H_cur, TURNED, SIZE) < 3 * sigma_px(fit.ref_H_cur, fit.covariance, SIZE)


def test_after_a_tilt_a_strip_is_too_uncertain() -> None:
    """What a similarity leaves out is as large as in the frames before."""
    registration = Registration(StabilizerConfig(), SIZE)
    tilted = TURNED + np.array([[0.0, 0, 0], [0, 0, 0], [5e-5, 3e-5, 0]])
    pairs = matches(places(0, SIZE[0]), tilted, 0.15)
    whole = registration.solve(pairs, np.eye(3), np.ones(len(pairs)), np.zeros(len(pairs), bool))
    assert whole is not None
    strip = matches(places(0, 0.06 * SIZE[0]), tilted, 0.15)
    fit = registration.after(whole).solve(strip, np.eye(3), np.ones(len(strip)), np.zeros(len(strip), bool))
    assert fit is not None
    assert fit.model == ""


def test_small_ground_among_much_that_disagrees_is_solid() -> None:
    at_px, weight = places(0, SIZE[0], 600), np.ones(600)
    ground = at_px[:, 0] < SIZE[0] / 8
    support = support_of(at_px, weight, ground, SIZE)
    assert support.share < 0.2
    assert support.is_solid


def test_as_many_that_agree_by_chance_all_over_are_not_solid() -> None:
    at_px, weight = places(0, SIZE[0], 600), np.ones(600)
    agrees = np.random.default_rng(5).random(600) < 0.13
    assert not support_of(at_px, weight, agrees, SIZE).is_solid


@pytest.mark.parametrize(("expected", "agreeing", "enough"),
                         [(600, 16, True), (60, 12, False), (10, 6, True), (10, 4, False)])
def test_a_few_that_agree_are_not_enough(expected: int, agreeing: int, enough: bool) -> None:
    at_px = places(0, SIZE[0], expected)
    support = support_of(at_px, np.ones(expected), np.arange(expected) < agreeing, SIZE)
    assert support.is_enough is enough
