"""Windows: the measurement of a known deformation, and the solver against numpy."""

from __future__ import annotations

import numpy as np
import pytest
from moving_water import Water, uniform

from stab_ros.velocimetry.alignment import Pose, align
from stab_ros.velocimetry.posterior import solve
from stab_ros.velocimetry.windows import TERMS, Seen, Windows, cut_windows, see

RADIUS = 15


def moved_by(shift_px: float, noise: float, contrast: float) -> tuple[Windows, Seen]:
    """Windows of a texture, and how they are seen exactly where it has moved to."""
    water = Water(uniform(25 * shift_px, 25 * shift_px), noise=noise, contrast=contrast)
    x, y = (one.ravel() for one in np.meshgrid(np.arange(30, 210, 15.0), np.arange(30, 150, 15.0)))
    centres = np.column_stack([x, y])
    windows = cut_windows(water.gray(0), centres, RADIUS)
    places = np.zeros((len(centres), 2, TERMS))
    places[:, :, 0], places[:, 0, 1], places[:, 1, 2] = centres + shift_px, RADIUS, RADIUS
    return windows, see(windows, np.arange(len(centres)), water.gray(1 / 25), places)


def test_the_solver_gives_the_mode_and_covariance_of_the_posterior() -> None:
    rng, n = np.random.default_rng(1), 5
    A = rng.normal(size=(n, 12, 30))
    R, G = A @ A.transpose(0, 2, 1) + rng.normal(0, 0.1, (n, 12, 12)), A @ A.transpose(0, 2, 1)
    products, noise, bent = rng.normal(size=(n, 12)), rng.uniform(1, 2, n), rng.normal(size=(n, 12))
    variance, chosen = rng.uniform(0.1, 2, (n, 12)), np.array([4, 2, 0, 1, 3])
    change, spread = np.zeros((n, 12)), np.zeros((n, 2, 2))
    solve(chosen, R, G, products, noise, bent, variance, change, spread)
    free = np.isin(np.arange(12), (0, 6))
    for i, c in enumerate(chosen):
        L = np.diag(np.where(free, 0, noise[i] * np.trace(G[c]) / np.trace(R[c]) / variance[i]))
        left = R[c] + L + 1e-5 * np.trace(R[c]) / 12 * np.eye(12)
        inverse = np.linalg.inv(left)
        whole = inverse @ (noise[i] * G[c] + L @ np.diag(variance[i]) @ L) @ inverse.T
        np.testing.assert_allclose(change[i], inverse @ (-products[i] - L @ bent[i]), rtol=1e-6, atol=1e-9)
        np.testing.assert_allclose(spread[i], whole[np.ix_([0, 6], [0, 6])], rtol=1e-6, atol=1e-9)


def test_a_window_finds_its_displacement_and_turn() -> None:
    turn = 0.05
    water = Water(uniform(0, 0), noise=0.5, size=(120, 100))
    R = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    centre, moved = np.array([60.0, 50]), np.array([2.3, -1.4])
    H = np.eye(3)
    H[:2, :2], H[:2, 2] = R.T, centre - R.T @ (centre + moved)  # what is at the centre lies at centre + moved later
    later = Water(uniform(0, 0), noise=0.5, size=(120, 100), camera_at=lambda _t: H)
    windows = cut_windows(water.gray(0), centre[None], 15)
    assumed = Pose(centre[None] + [2.0, -1.0], np.eye(2)[None], np.zeros((1, 2, TERMS)))
    sigma = np.array([[0, 2.0, 2.0, 0, 0, 0]])
    found = align(windows, np.array([0]), later.gray(1.0), assumed, sigma, 0.01)
    np.testing.assert_allclose(found.pose.at_px[0], centre + moved, atol=0.03)
    np.testing.assert_allclose(found.pose.bent_px[0, :, 1:3] / 15, R - np.eye(2), atol=0.004)
    assert found.correlation[0] > 0.98
    assert 1e-4 < found.covariance_px2[0, 0, 0] ** 0.5 < 0.03


def test_a_window_outside_the_image_is_not_seen() -> None:
    gray = Water(uniform(0, 0), size=(120, 100)).gray(0)
    windows = cut_windows(gray, np.array([[60.0, 50]]), 15)
    places = np.zeros((2, 2, TERMS))
    places[:, 0, 0], places[:, 1, 0], places[:, 0, 1], places[:, 1, 2] = [60, 10], 50, 15, 15
    seen = see(windows, np.array([0, 0]), gray, places)
    assert seen.gain[0] > 0.99
    assert seen.gain[1] == 0


@pytest.mark.parametrize("contrast", [10.0, 40.0])
def test_interpolation_between_pixels_is_neither_noise_nor_motion(contrast: float) -> None:
    _, whole = moved_by(1.0, 1.0, contrast)
    windows, half = moved_by(1.5, 1.0, contrast)
    assert 0.6 < np.median(half.noise) / np.median(whole.noise) < 1.4
    variance = np.einsum("nii->ni", windows.gram) * half.noise[:, None]
    assert 0.7 < np.mean(half.products**2 / variance) < 1.3


def test_noise_of_the_template_is_not_taken_for_less_contrast() -> None:
    windows, seen = moved_by(1.0, 4.0, 8.0)
    assert 0.2 * windows.power.mean() / (2 * RADIUS + 1) ** 2 < 4.0**2
    np.testing.assert_allclose(np.median(seen.gain), 1, atol=0.06)
    assert 0.8 < np.median(seen.noise) / (2 * 4.0**2) < 1.5
