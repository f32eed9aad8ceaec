"""Noise of an image, and its share in RMSD^2 after a warp."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from truth import IDENTITY, flat, picture, similarity, translation

from stab_ros.core.types import FloatArray, Homography
from stab_ros.metrics.noise import NoiseGauge, interpolated_share
from stab_ros.metrics.rmsd import cut, rmsd

SIZE = (640, 480)
CENTRES = np.array([[60, 50], [320, 240], [590, 400], [200, 33]])


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
