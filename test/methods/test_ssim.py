"""Structural similarity against its formula, and points against pictures whose homographies are known."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from truth import IDENTITY, SIZE, flat, picture, projective, random_noise, similarity, translation

from stab_ros.core.errors import ConfigError
from stab_ros.core.geometry import apply
from stab_ros.core.types import NO_POINTS, Correspondences, FloatArray, Gray, Homography
from stab_ros.methods._ssim_maps import ssim_maps
from stab_ros.methods.ssim import Ssim, SsimConfig

EVERYWHERE = np.ones(SIZE[::-1], bool)
POINTS = np.array([[80.0, 60.0], [310.4, 71.8], [95.0, 230.0], [300.0, 220.0], [200.0, 150.0]])
PLAIN = SsimConfig(area=11, search=21, update_kernels=False, second_look=False)


def found(config: SsimConfig, current: Gray, guess: Homography = IDENTITY,
          points_px: FloatArray = POINTS) -> Correspondences:
    method = Ssim(picture(), EVERYWHERE, config, points_px)
    return method.match(current, guess, np.ones(len(method.reference_px)))


def errors_px(pairs: Correspondences, ref_H_cur: Homography) -> FloatArray:
    """(n, 2), reference side."""
    return apply(ref_H_cur, pairs.current_px) - pairs.reference_px


def structural_similarity(a: FloatArray, b: FloatArray, window: int) -> float:
    """Wang et al. (2004), eq. 13, averaged over all windows: to the letter."""
    values = []
    for i in range(len(a) - window + 1):
        for j in range(len(a) - window + 1):
            x, y = (image[i : i + window, j : j + window].ravel() for image in (a, b))
            c1, c2, (xx, xy, _, yy) = (0.01 * 255) ** 2, (0.03 * 255) ** 2, np.cov(x, y).ravel()
            values.append((2 * x.mean() * y.mean() + c1) * (2 * xy + c2)
                          / ((x.mean() ** 2 + y.mean() ** 2 + c1) * (xx + yy + c2)))
    return float(np.mean(values))


@pytest.mark.parametrize(("side", "window"), [(11, 7), (9, 9), (8, 3), (7, 40)])
def test_the_map_is_the_formula_at_every_place(side: int, window: int) -> None:
    kernels = np.stack([picture()[40 : 40 + side, 60 : 60 + side], random_noise()[:side, :side]]).astype(np.float32)
    reach = side + 4
    areas = np.stack([picture(translation(1, 2))[38 : 38 + reach, 58 : 58 + reach], picture()[:reach, :reach]])
    maps = ssim_maps(kernels, areas.astype(np.float32), window)
    assert maps.shape == (2, 5, 5)
    for k in range(2):
        expected = [[structural_similarity(kernels[k].astype(float), areas[k, y : y + side, x : x + side].astype(float),
                                           min(window, side)) for x in range(5)] for y in range(5)]
        np.testing.assert_allclose(maps[k], expected, atol=2e-4)


def test_what_is_the_same_scores_one() -> None:
    kernel = picture()[None, 50:61, 70:81].astype(np.float32)
    assert ssim_maps(kernel, kernel, 7)[0, 0, 0] == pytest.approx(1.0, abs=1e-4)


def test_standing_still_is_exact() -> None:
    pairs = found(PLAIN, picture())
    np.testing.assert_allclose(pairs.current_px, pairs.reference_px, atol=1e-9)
    assert len(pairs) == 5


@pytest.mark.parametrize("motion", [translation(3.37, -2.61), similarity(1.5, 1.0, 1.5, 0.7), similarity(0.0, 1.02)],
                         ids=["shift", "rotation", "zoom"])
@pytest.mark.parametrize("config", [PLAIN, SsimConfig(), SsimConfig(subpixel=5)], ids=["11/21", "21/41", "5x5"])
def test_points_are_found_where_they_are(motion: Homography, config: SsimConfig) -> None:
    pairs = found(config, picture(motion))
    assert pairs.feature_id.tolist() == [0, 1, 2, 3, 4]
    assert np.median(np.abs(errors_px(pairs, motion))) < 0.06
    assert np.abs(errors_px(pairs, motion)).max() < 0.25


def test_areas_follow_the_guess() -> None:
    motion = translation(45.3, -30.2)
    pairs = found(PLAIN, picture(motion), translation(43.0, -29.0))
    assert len(pairs) >= 4
    assert np.abs(errors_px(pairs, motion)).max() < 0.15
    assert len(found(PLAIN, picture(motion), IDENTITY)) < 3


@pytest.mark.parametrize("degrees", [15.0, 60.0, -120.0])
def test_updated_kernels_survive_a_large_rotation(degrees: float) -> None:
    motion = similarity(degrees, 1.0)
    plain, updated = (found(SsimConfig(update_kernels=update, second_look=False), picture(motion), motion,
                            points_px=POINTS) for update in (False, True))
    assert len(updated) == 5
    assert np.abs(errors_px(updated, motion)).max() < 0.2
    wrong = np.abs(errors_px(plain, motion)).max(axis=1) > 0.5
    assert len(plain) - wrong.sum() < 5


def test_the_search_expands_for_what_was_not_found() -> None:
    motion = translation(8.4, -7.7)
    settings: dict[str, Any] = {"area": 11, "search": 21, "second_look": False}
    assert len(found(SsimConfig(**settings, min_score=0.7), picture(motion))) < 5
    pairs = found(SsimConfig(**settings, min_score=0.7, expand=True), picture(motion))
    assert len(pairs) == 5
    assert np.abs(errors_px(pairs, motion)).max() < 0.2


def test_points_beyond_reach_are_found_by_their_neighbours() -> None:
    motion = similarity(3.0, 1.0, 5.0, 0.0)
    once, twice = (found(SsimConfig(second_look=second), picture(motion), points_px=NO_POINTS)
                   for second in (False, True))
    assert len(twice) > 1.2 * len(once)
    assert np.quantile(np.abs(errors_px(twice, motion)), 0.9) < 0.15


@pytest.mark.parametrize("current", [flat(), random_noise()], ids=["flat", "noise"])
def test_what_is_not_there_is_not_reported(current: Gray) -> None:
    assert len(found(SsimConfig(), current)) == 0


def test_information_is_as_large_as_the_errors_say() -> None:
    motion = similarity(0.5, 1.004, 2.3, 1.6)
    pairs = found(SsimConfig(points=200), picture(motion, noise=4.0), points_px=NO_POINTS)
    e = errors_px(pairs, motion)
    chi2 = np.einsum("ni,nij,nj->n", e, pairs.information, e) / 2
    assert 0.2 < np.median(chi2) < 2.0
    assert 0.3 < np.mean(chi2[np.abs(e).max(axis=1) < 0.5]) < 3.0


def test_points_whose_kernel_leaves_the_picture_are_left_out() -> None:
    method = Ssim(picture(), EVERYWHERE, PLAIN, np.array([[4.4, 100.0], [4.6, 100.3], [200.0, 297.0], [200.0, 150.0]]))
    np.testing.assert_array_equal(method.reference_px, [[5, 100], [200, 150]])


@pytest.mark.parametrize("values", [{"area": 20}, {"search": 22}, {"subpixel": 4}, {"area": 21, "search": 21}])
def test_wrong_sides_are_refused_in_one_line(values: dict[str, Any]) -> None:
    with pytest.raises(ConfigError, match=r"^ssim\.\w+: [^\n]*must") as refusal:
        SsimConfig(**values)
    assert "\n" not in str(refusal.value)


def test_a_point_found_once_is_found_the_same_again() -> None:
    method = Ssim(picture(), EVERYWHERE, SsimConfig())
    trust = np.ones(len(method.reference_px))
    first = method.match(picture(projective()), IDENTITY, trust)
    method.match(picture(translation(20, 3)), translation(19, 3), trust)
    again = method.match(picture(projective()), IDENTITY, trust)
    np.testing.assert_array_equal(first.current_px, again.current_px)
