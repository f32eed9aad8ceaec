"""RMSD by hand and by plain loops, and the noise that is taken out of it before it becomes a displacement."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from truth import IDENTITY, flat, picture, similarity, translation

from stab_ros.core.types import FloatArray, Homography
from stab_ros.metrics.alignment import follow
from stab_ros.metrics.noise import NoiseGauge, interpolated_share
from stab_ros.metrics.rmsd import cut, rmsd

SIZE = (640, 480)
CENTRES = np.array([[60, 50], [320, 240], [590, 400], [200, 33]])


def test_rmsd_of_four_numbers_by_hand() -> None:
    """Differences 1, 2, 2 and 4 have squares of 1 + 4 + 4 + 16 = 25, a mean of 6.25 and a root of 2.5."""
    a, b = np.array([[[10, 20], [30, 40.0]]]), np.array([[[11, 18], [32, 36.0]]])
    assert rmsd(a, b) == pytest.approx([2.5])


@pytest.mark.parametrize("window_px", [1, 15, 31, 51])
def test_rmsd_of_pictures_by_plain_loops(window_px: int) -> None:
    a, b = picture(IDENTITY, SIZE), picture(translation(0.7, -0.4), SIZE, gain=1.1)
    expected = []
    for x, y in CENTRES.tolist():
        half = window_px // 2
        total = sum((int(a[y + i, x + j]) - int(b[y + i, x + j])) ** 2
                    for i in range(-half, half + 1) for j in range(-half, half + 1))
        expected.append((total / window_px**2) ** 0.5)
    assert rmsd(cut(a, CENTRES, window_px), cut(b, CENTRES, window_px)) == pytest.approx(expected, rel=1e-12)


def test_what_differs_by_a_constant_differs_by_it() -> None:
    a = picture(IDENTITY, SIZE)
    assert rmsd(cut(a, CENTRES, 31), cut(a, CENTRES, 31) + 3) == pytest.approx(3)


@pytest.mark.parametrize(("centre", "window_px"), [((14, 50), 31), ((50, 14), 31), ((625, 50), 31), ((50, 465), 31),
                                                   ((50, 50), 30), ((50, 50), 0)])
def test_windows_that_are_even_or_leave_the_picture_are_refused(centre: tuple[int, int], window_px: int) -> None:
    with pytest.raises(ValueError, match="window of"):
        cut(picture(IDENTITY, SIZE), np.array([centre]), window_px)
    with pytest.raises(ValueError, match="one shape"):
        rmsd(np.zeros((1, 3, 3)), np.zeros((1, 5, 5)))


@pytest.mark.parametrize(("x_px", "y_px"), [(0.3, -0.7), (2.5, 1.25), (0.0, 0.0), (-3.0, 1.0)])
def test_windows_that_follow_the_shift_show_the_same(x_px: float, y_px: float) -> None:
    a, b = picture(IDENTITY, SIZE, noise=0), picture(translation(-x_px, -y_px), SIZE, noise=0)
    shifts = np.tile([x_px, y_px], (len(CENTRES), 1))
    inner = CENTRES[1:3]
    followed = follow(b, inner, 31, shifts[1:3])
    assert rmsd(cut(a, inner, 31), followed).max() < 1.3  # of rounding and of what the grain holds near Nyquist
    if (x_px, y_px) != (0, 0):
        assert rmsd(cut(a, inner, 31), cut(b, inner, 31)).min() > 5


def test_what_has_no_shift_or_leaves_the_picture_is_not_followed() -> None:
    shifts = np.array([[0.5, 0.5], [np.nan, np.nan], [60.0, 0.0], [0.0, -15.0]])
    known = np.isfinite(follow(picture(IDENTITY, SIZE), CENTRES, 31, shifts)).all(axis=(1, 2))
    assert known.tolist() == [True, False, False, False]


@pytest.mark.parametrize("sigma", [0.0, 1.0, 2.0, 4.0])
def test_noise_is_measured(sigma: float) -> None:
    """In what a lens has drawn: a texture that is sharp to the pixel counts as noise in part."""
    for seed in (1, 2):
        lens = cv2.GaussianBlur(np.asarray(picture(IDENTITY, SIZE, seed, 0), np.float32), (0, 0), 0.7)
        grain = np.random.default_rng(seed).normal(0, sigma, lens.shape)
        image = np.asarray(np.clip(np.round(lens + grain), 0, 255), np.uint8)
        found = NoiseGauge(image).sigma(image)
        assert found < 0.5 if sigma == 0 else found == pytest.approx(sigma, rel=0.1)


def test_noise_of_a_picture_of_nothing() -> None:
    image = flat(noise=2.0, size=SIZE)
    assert NoiseGauge(image).sigma(image) == pytest.approx(2.0, rel=0.05)
    with pytest.raises(ValueError, match="33x33"):
        NoiseGauge(image[:20])


def warped(image: FloatArray, H: Homography) -> FloatArray:
    return np.asarray(cv2.warpPerspective(image, H, SIZE, flags=cv2.INTER_LINEAR))


@pytest.mark.parametrize("H", [translation(0.5, 0.5), translation(3.25, 0), translation(-2, 7), similarity(2, 1.01)])
def test_what_interpolation_leaves_of_noise(H: Homography) -> None:
    """Against cv2, on noise finely quantised."""
    noise = np.random.default_rng(5).normal(0, 1, SIZE[::-1]).astype(np.float32)
    middle = CENTRES[1:2]
    left = cut(warped(noise, H), middle, 201).var(axis=(1, 2))
    assert interpolated_share(H, middle, 201) == pytest.approx(left, rel=0.08)


def test_the_share_of_noise_in_rmsd_is_known() -> None:
    """Two pictures that stand still differ by noise alone: 2 sigma^2, or less once one of them was warped."""
    still, again = (picture(IDENTITY, SIZE, noise=2.0, offset=o) for o in (0, 1e-9))
    again = np.asarray(np.clip(again + np.random.default_rng(1).normal(0, 2, still.shape), 0, 255), np.uint8)
    share = NoiseGauge(still).share(again, None, CENTRES, 31)
    between = np.mean(rmsd(cut(still, CENTRES, 31), cut(again, CENTRES, 31)) ** 2)
    assert share == pytest.approx(np.full(len(CENTRES), between), rel=0.15)
