"""FFT cross-correlation against direct sums, OpenCV, and pictures whose homographies are known."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import pytest
from truth import IDENTITY, SIZE, flat, picture, projective, random_noise, similarity, translation

from stab_ros.core.errors import ConfigError
from stab_ros.core.geometry import apply
from stab_ros.core.types import NO_POINTS, Correspondences, FloatArray, Gray, Homography
from stab_ros.methods._affine_windows import AffineMaps
from stab_ros.methods.fft import CorrelationPass, Fft, FftConfig, _displacement_field

EVERYWHERE = np.ones(SIZE[::-1], bool)
POINTS = np.array([[80.0, 60.0], [310.4, 71.8], [95.0, 230.0], [300.0, 220.0], [200.0, 150.0]])
CUAS = FftConfig(passes="32,16", steps="16,8", second_look=False)


def found(config: FftConfig, current: Gray, guess: Homography = IDENTITY, points_px: FloatArray = POINTS,
          reference: Gray | None = None) -> Correspondences:
    method = Fft(picture() if reference is None else reference, EVERYWHERE, config, points_px)
    return method.match(current, guess, np.ones(len(method.reference_px)))


def errors_px(pairs: Correspondences, ref_H_cur: Homography) -> FloatArray:
    """(n, 2), reference side."""
    return apply(ref_H_cur, pairs.current_px) - pairs.reference_px


def test_the_plane_is_the_normalised_circular_correlation() -> None:
    side, centre = 16, np.array([[60.5, 70.5]])
    only = CorrelationPass.of(picture(), centre, side, np.zeros((1, 2)))
    plane = only.correlate(picture(translation(2, -1)), AffineMaps.identity(centre), np.arange(1))[0, 0]
    cut = np.s_[63:79, 53:69]
    a, b = (image[cut].astype(float) - image[cut].mean() for image in (picture(), picture(translation(2, -1))))
    expected = [[np.sum(a * np.roll(b, (-y, -x), (0, 1))) for x in range(-8, 8)] for y in range(-8, 8)]
    np.testing.assert_allclose(plane, np.array(expected) / np.sqrt(np.sum(a * a) * np.sum(b * b)), atol=1e-9)


def test_whole_pixels_are_those_of_opencv() -> None:
    current = picture(translation(-5, 4))
    pairs = found(CUAS, current)
    for at, place in zip(pairs.reference_px, pairs.current_px, strict=True):
        x, y = (int(v) - 15 for v in at)
        search = current[y - 10 : y + 42, x - 10 : x + 42]
        scores = cv2.matchTemplate(search, picture()[y : y + 32, x : x + 32], cv2.TM_CCOEFF_NORMED)
        best = cv2.minMaxLoc(scores)[3]
        np.testing.assert_allclose(place - at, np.array(best) - 10, atol=0.1)
    assert len(pairs) == 5


@pytest.mark.parametrize("motion", [translation(3.37, -2.61), similarity(2.5, 1.0, 1.5, 0.7), similarity(0.0, 1.03),
                                    projective()], ids=["shift", "rotation", "zoom", "projective"])
@pytest.mark.parametrize("passes", ["32,16", "48,32,32"])
def test_points_are_found_where_they_are(motion: Homography, passes: str) -> None:
    pairs = found(FftConfig(passes=passes), picture(motion))
    assert pairs.feature_id.tolist() == [0, 1, 2, 3, 4]
    assert np.abs(errors_px(pairs, motion)).max() < 0.15
    assert np.median(np.abs(errors_px(pairs, motion))) < 0.04


def test_deformation_is_what_later_passes_gain() -> None:
    motion = similarity(5.0, 1.02)
    spread = [np.sqrt(np.mean(errors_px(found(FftConfig(passes=passes, second_look=False, min_correlation=0.1),
                                              picture(motion), points_px=POINTS), motion) ** 2))
              for passes in ("48", "48,48", "48,48,48")]
    assert spread[1] < 0.5 * spread[0]
    assert spread[2] < 0.05


def test_areas_follow_the_guess_or_stay() -> None:
    motion = similarity(0.0, 1.0, 45.0, -30.0)
    near = similarity(0.2, 1.0, 43.0, -29.0)
    assert len(found(CUAS, picture(motion), near)) >= 4
    assert np.abs(errors_px(found(CUAS, picture(motion), near), motion)).max() < 0.1
    stay = FftConfig(passes="32,16", follow=False)
    assert len(found(stay, picture(motion), near)) == 0
    small = picture(translation(3.0, 1.5))
    np.testing.assert_array_equal(found(stay, small, near).current_px, found(stay, small, IDENTITY).current_px)


def test_corner_windows_that_stay() -> None:
    motion = projective()
    pairs = found(FftConfig(layout="corners", passes="96", follow=False), picture(motion), points_px=NO_POINTS)
    assert len(pairs) == 4
    assert np.abs(errors_px(pairs, motion)).max() < 0.4


@pytest.mark.parametrize(("gain", "offset"), [(0.7, 45.0), (1.1, -10.0), (1.0, 25.0)])
def test_brightness_does_not_matter(gain: float, offset: float) -> None:
    motion = translation(1.3, -2.2)
    pairs = found(CUAS, picture(motion, gain=gain, offset=offset))
    assert len(pairs) == 5
    assert np.abs(errors_px(pairs, motion)).max() < 0.1


def test_a_pattern_that_repeats_is_ambiguous() -> None:
    y, x = np.mgrid[: SIZE[1], : SIZE[0]]
    squares = np.asarray(128 + 60 * np.sign(np.sin(x / 4 * np.pi) * np.sin(y / 4 * np.pi)), np.uint8)
    assert len(found(FftConfig(min_peak_ratio=1.2), squares, reference=squares)) == 0
    assert len(found(FftConfig(min_peak_ratio=1.2), picture(translation(1, 1)))) == 5


@pytest.mark.parametrize("current", [flat(), random_noise(), picture(seed=2)], ids=["flat", "noise", "other scene"])
def test_what_is_not_there_is_not_reported(current: Gray) -> None:
    assert len(found(CUAS, current)) <= 1


def test_points_beyond_reach_are_found_by_their_neighbours() -> None:
    motion = similarity(4.0, 1.0, 6.0, 0.0)
    once, twice = (found(FftConfig(passes="24,24", second_look=second), picture(motion), points_px=NO_POINTS)
                   for second in (False, True))
    assert len(twice) > 1.3 * len(once)
    assert np.quantile(np.abs(errors_px(twice, motion)), 0.9) < 0.3
    assert (np.diff(twice.feature_id) > 0).all()


def test_information_is_as_large_as_the_errors_say() -> None:
    motion = similarity(0.5, 1.004, 2.3, 1.6)
    pairs = found(FftConfig(points=200), picture(motion, noise=4.0), points_px=NO_POINTS)
    e = errors_px(pairs, motion)
    chi2 = np.einsum("ni,nij,nj->n", e, pairs.information, e) / 2
    assert 0.2 < np.median(chi2) < 2.0
    assert 0.3 < np.mean(chi2[np.abs(e).max(axis=1) < 0.5]) < 3.0


def test_points_whose_area_leaves_the_picture_are_left_out() -> None:
    method = Fft(picture(), EVERYWHERE, CUAS, np.array([[14.9, 100.2], [15.6, 100.2], [-40.0, 5.0], [200.2, 150.2]]))
    np.testing.assert_array_equal(method.reference_px, [[15.5, 100.5], [200.5, 150.5]])


def test_chosen_points_lie_where_they_may() -> None:
    allowed = EVERYWHERE.copy()
    allowed[100:, :] = False
    method = Fft(picture(), allowed, FftConfig(points=30))
    assert 10 < len(method.reference_px) <= 30
    assert method.reference_px[:, 1].max() <= 99


@pytest.mark.parametrize("values", [{"passes": "32,15"}, {"passes": "4"}, {"passes": "a"}, {"passes": ""},
                                    {"passes": "32,16", "steps": "16"}, {"passes": "32", "steps": "0"},
                                    {"passes": "1024"}])
def test_wrong_passes_are_refused_in_one_line(values: dict[str, Any]) -> None:
    with pytest.raises(ConfigError, match=r"^fft\.(passes|steps): [^\n]*must") as refusal:
        FftConfig(**values)
    assert "\n" not in str(refusal.value)


def test_a_point_found_once_is_found_the_same_again() -> None:
    method = Fft(picture(), EVERYWHERE, FftConfig())
    trust = np.ones(len(method.reference_px))
    first = method.match(picture(projective()), IDENTITY, trust)
    method.match(picture(translation(20, 3)), translation(19, 3), trust)
    again = method.match(picture(projective()), IDENTITY, trust)
    np.testing.assert_array_equal(first.current_px, again.current_px)


def test_a_vector_that_disagrees_does_not_bend_the_field() -> None:
    offsets = 8.0 * np.array([[x, y] for y in (-1, 0, 1) for x in (-1, 0, 1)])
    gradient = np.array([[0.01, -0.05], [0.05, 0.01]])
    shift = np.tile(offsets @ gradient.T + [1.5, -0.5], (3, 1, 1))
    shift[1, 2] = [-6.0, 3.0]
    shift[2, :5], shift[2, 6:] = np.nan, np.nan
    displacement, bent = _displacement_field(shift, offsets)
    np.testing.assert_allclose(displacement[:2], [[1.5, -0.5]] * 2, atol=1e-6)
    np.testing.assert_allclose(bent[:2], [gradient] * 2, atol=1e-6)
    np.testing.assert_array_equal(bent[2], np.zeros((2, 2)))
