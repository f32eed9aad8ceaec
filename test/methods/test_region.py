"""Planar markers against direct sums and against pictures whose homographies are known."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import pytest
from truth import IDENTITY, SIZE, flat, picture, projective, random_noise, similarity, translation

from stab_ros.core.errors import ConfigError
from stab_ros.core.geometry import apply
from stab_ros.core.types import NO_POINTS, Correspondences, FloatArray, Gray, Homography, Image
from stab_ros.methods import _planar
from stab_ros.methods._affine_windows import AffineMaps, sample
from stab_ros.methods.region import RegionConfig, RegionMethod

EVERYWHERE = np.ones(SIZE[::-1], bool)
POINTS = np.array([[80.0, 60.0], [310.4, 71.8], [95.0, 230.0], [300.0, 220.0], [200.0, 150.0]])
MANUAL = RegionConfig(area=21, search=41, second_look=False)


def found(config: RegionConfig, current: Gray, guess: Homography = IDENTITY,
          points_px: FloatArray = POINTS) -> Correspondences:
    method = RegionMethod(picture(), EVERYWHERE, config, points_px)
    return method.match(current, guess, np.ones(len(method.reference_px)))


def errors_px(pairs: Correspondences, ref_H_cur: Homography) -> FloatArray:
    """(n, 2), reference side."""
    return apply(ref_H_cur, pairs.current_px) - pairs.reference_px


def blurred(image: Gray) -> Image:
    return np.asarray(cv2.GaussianBlur(image.astype(np.float32), (0, 0), 0.9))


def test_the_search_is_the_sum_of_absolute_differences() -> None:
    rng = np.random.default_rng(2)
    areas = rng.integers(0, 256, (6, 19, 19)).astype(np.float32)
    patterns = rng.integers(0, 256, (6, 9, 9)).astype(np.float32)
    lag, clear = _planar.best_lag(patterns, areas)
    for k in range(6):
        sums = [[np.abs((cut := areas[k, y : y + 9, x : x + 9].astype(float)) - cut.mean() - patterns[k]
                        + patterns[k].mean()).sum() for x in range(11)] for y in range(11)]
        y, x = np.unravel_index(np.argmin(sums), (11, 11))
        assert lag[k].tolist() == [x - 5, y - 5]
        assert clear[k] == (0 < x < 10 and 0 < y < 10)


@pytest.mark.parametrize(("motion", "truth"), [
    ("translation", translation(0.7, -0.4)), ("translation_rotation", similarity(6.0, 1.0, 0.4, 0.3)),
    ("translation_scale", similarity(0.0, 1.06, -0.3, 0.5)),
    ("translation_rotation_scale", similarity(-5.0, 0.95, 0.2, 0.6)),
    ("affine", np.array([[1.04, 0.06, 0.0], [-0.02, 0.95, 0.0], [0, 0, 1.0]])),
])
def test_the_refinement_finds_turn_and_size(motion: str, truth: Homography) -> None:
    cur_H_ref, centre = np.linalg.inv(truth), np.array([[200.0, 150.0]])
    start = AffineMaps.identity(np.round(apply(cur_H_ref, centre)))
    pattern = sample(blurred(picture(noise=0)), AffineMaps.identity(centre), 33)
    marker = _planar.refine(blurred(picture(truth, noise=0)), pattern, start, motion, 30)
    np.testing.assert_allclose(marker.maps.centres, apply(cur_H_ref, centre), atol=0.05)
    np.testing.assert_allclose(marker.maps.linear[0], cur_H_ref[:2, :2], atol=0.008)
    assert marker.correlation[0] > 0.98


def test_a_marker_that_may_not_turn_looks_less_like_its_pattern() -> None:
    truth, centre = similarity(9.0, 1.0), np.array([[200.0, 150.0]])
    pattern, start = sample(blurred(picture()), AffineMaps.identity(centre), 33), AffineMaps.identity(centre)
    free, fixed = (_planar.refine(blurred(picture(truth)), pattern, start, motion, 30).correlation[0]
                   for motion in ("translation_rotation_scale", "translation"))
    assert free > fixed + 0.02


@pytest.mark.parametrize("truth", [translation(3.37, -2.61), similarity(2.0, 1.0, 1.5, 0.7), similarity(0.0, 1.03),
                                   projective()], ids=["shift", "rotation", "zoom", "projective"])
@pytest.mark.parametrize("motion", list(_planar.MOTIONS))
def test_markers_are_found_where_they_are(truth: Homography, motion: str) -> None:
    pairs = found(RegionConfig(motion=motion), picture(truth))
    assert pairs.feature_id.tolist() == [0, 1, 2, 3, 4]
    assert np.abs(errors_px(pairs, truth)).max() < 0.12


@pytest.mark.parametrize(("gain", "offset"), [(0.7, 45.0), (1.1, -10.0), (1.0, 25.0)])
def test_brightness_does_not_matter(gain: float, offset: float) -> None:
    truth = translation(1.3, -2.2)
    pairs = found(MANUAL, picture(truth, gain=gain, offset=offset))
    assert len(pairs) == 5
    assert np.abs(errors_px(pairs, truth)).max() < 0.08


def test_a_marker_that_is_covered_is_lost() -> None:
    current = picture(translation(1.0, 1.0)).copy()
    current[120:180, 170:230] = random_noise()[120:180, 170:230]
    assert found(MANUAL, current).feature_id.tolist() == [0, 1, 2, 3]


def test_correlation_decides_what_is_lost() -> None:
    noisy = picture(translation(1.0, 0.5), noise=14.0)
    counts = [len(found(RegionConfig(min_correlation=least), noisy, points_px=NO_POINTS)) for least in (0.5, 0.9, 0.98)]
    assert counts[0] >= counts[1] > counts[2]


@pytest.mark.parametrize("current", [flat(), random_noise(), picture(seed=2)], ids=["flat", "noise", "other scene"])
def test_what_is_not_there_is_not_reported(current: Gray) -> None:
    assert len(found(MANUAL, current)) <= 1


def test_areas_follow_the_guess_with_its_turn() -> None:
    truth = similarity(50.0, 1.05, 12.0, -9.0)
    pairs = found(MANUAL, picture(truth), similarity(50.5, 1.045, 13.0, -8.0))
    assert len(pairs) >= 4
    assert np.abs(errors_px(pairs, truth)).max() < 0.12


def test_markers_apart_and_clear_of_the_border() -> None:
    method = RegionMethod(picture(), EVERYWHERE, RegionConfig(min_distance=70.0, margin=40))
    places = method.reference_px
    apart = np.hypot(*(places[:, None] - places[None]).T) + 1e9 * np.eye(len(places))
    assert len(places) >= 4
    assert apart.min() >= 69
    assert places.min() >= 40
    assert (places <= np.array(SIZE) - 41).all()


def test_information_is_as_large_as_the_errors_say() -> None:
    truth = similarity(0.5, 1.004, 2.3, 1.6)
    pairs = found(RegionConfig(points=200), picture(truth, noise=4.0), points_px=NO_POINTS)
    e = errors_px(pairs, truth)
    chi2 = np.einsum("ni,nij,nj->n", e, pairs.information, e) / 2
    assert 0.2 < np.median(chi2) < 2.0
    assert 0.3 < np.mean(chi2[np.abs(e).max(axis=1) < 0.5]) < 3.0


@pytest.mark.parametrize("values", [{"area": 20}, {"search": 22}, {"area": 31, "search": 21}])
def test_wrong_sides_are_refused_in_one_line(values: dict[str, Any]) -> None:
    with pytest.raises(ConfigError, match=r"^region\.\w+: [^\n]*must") as refusal:
        RegionConfig(**values)
    assert "\n" not in str(refusal.value)


def test_a_marker_found_once_is_found_the_same_again() -> None:
    method = RegionMethod(picture(), EVERYWHERE, RegionConfig())
    trust = np.ones(len(method.reference_px))
    first = method.match(picture(projective()), IDENTITY, trust)
    method.match(picture(translation(20, 3)), translation(19, 3), trust)
    again = method.match(picture(projective()), IDENTITY, trust)
    np.testing.assert_array_equal(first.current_px, again.current_px)
