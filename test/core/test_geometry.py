"""Homographies: where they move points, their distances and uncertainties, and what no camera can have made."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from truth import IDENTITY, SIZE, projective, similarity, translation

from stab_ros.core.geometry import (
    apply,
    grid,
    inside,
    is_plausible,
    jacobian,
    level_scale,
    normalized,
    rms_distance,
    sigma_px,
)
from stab_ros.core.types import FloatArray, Homography

POINTS = np.array([[0, 0], [399, 0], [12.5, 299], [200, 150.25], [399, 299]])


def with_entries(entries: FloatArray) -> Homography:
    return np.append(entries, 1.0).reshape(3, 3)


def test_points_move_as_opencv_moves_them() -> None:
    expected = cv2.perspectiveTransform(POINTS[None], projective())[0]
    np.testing.assert_allclose(apply(projective(), POINTS), expected, atol=1e-9)


@given(st.floats(-50, 50), st.floats(-50, 50), st.floats(-20, 20), st.floats(0.7, 1.4))
def test_applying_one_after_the_other_is_the_product(x: float, y: float, degrees: float, scale: float) -> None:
    first, second = similarity(degrees, scale, x, y), projective()
    np.testing.assert_allclose(apply(second @ first, POINTS), apply(second, apply(first, POINTS)), atol=1e-6)
    np.testing.assert_allclose(apply(np.linalg.inv(first), apply(first, POINTS)), POINTS, atol=1e-6)


def test_grid_is_the_contract_s() -> None:
    points = grid((1920, 1080))
    assert points.shape == (81, 2)
    assert set(points[:, 0]) == {k * 1919 / 8 for k in range(9)}
    assert set(points[:, 1]) == {k * 1079 / 8 for k in range(9)}


def test_distance_of_a_shift_is_its_length() -> None:
    assert rms_distance(translation(3, -4), IDENTITY, SIZE) == pytest.approx(5.0)


def test_distance_of_a_zoom_by_hand() -> None:
    zoom = np.diag([1.01, 1.0, 1.0])  # moves x by x/100; the mean square of k/8, k = 0..8, is 204/576
    assert rms_distance(zoom, IDENTITY, (401, 200)) == pytest.approx(4.0 * np.sqrt(204 / 576))


def test_distance_is_that_of_the_mapped_points() -> None:
    far = cv2.perspectiveTransform(grid(SIZE)[None], projective())[0] - grid(SIZE)
    assert rms_distance(projective(), IDENTITY, SIZE) == pytest.approx(np.sqrt((far**2).sum(axis=1).mean()))


def test_jacobian_is_the_derivative() -> None:
    entries, step = projective().ravel()[:8], 1e-6
    J = jacobian(projective(), POINTS)
    for k in range(8):
        ahead, back = entries.copy(), entries.copy()
        ahead[k] += step
        back[k] -= step
        numeric = (apply(with_entries(ahead), POINTS) - apply(with_entries(back), POINTS)) / (2 * step)
        np.testing.assert_allclose(J[:, :, k], numeric, rtol=1e-5, atol=1e-6)


def test_sigma_is_the_scatter_of_the_grid() -> None:
    rng, H = np.random.default_rng(4), projective()
    spread = np.array([2e-4, 1e-4, 0.05, 1e-4, 3e-4, 0.08, 2e-7, 3e-7])
    mixing = np.linalg.qr(rng.standard_normal((8, 8)))[0] * np.linspace(0.5, 1.5, 8)
    covariance = np.diag(spread) @ mixing @ mixing.T @ np.diag(spread)
    drawn = rng.multivariate_normal(H.ravel()[:8], covariance, size=4000)
    squared = [rms_distance(with_entries(entries), H, SIZE) ** 2 for entries in drawn]
    assert sigma_px(H, covariance, SIZE) == pytest.approx(np.sqrt(np.mean(squared)), rel=0.05)


@pytest.mark.parametrize("level", [1, 2, 3])
def test_levels_lie_where_area_averaging_puts_them(level: int) -> None:
    x, y = np.meshgrid(np.arange(64, dtype=np.float32), np.arange(48, dtype=np.float32))
    averaged = []
    for ramp in (x, y):  # a ramp's grey level is its own coordinate
        picture = ramp
        for _ in range(level):
            picture = cv2.resize(picture, (picture.shape[1] // 2, picture.shape[0] // 2), interpolation=cv2.INTER_AREA)
        averaged.append(picture)
    places = np.stack([picture.ravel() for picture in averaged], axis=1).astype(float)
    rows, columns = np.divmod(np.arange(len(places)), averaged[0].shape[1])
    np.testing.assert_allclose(apply(level_scale(level), places), np.stack([columns, rows], axis=1), atol=1e-5)


def test_inside_counts_pixel_centres() -> None:
    points = np.array([[0, 0], [399, 299], [-0.01, 5], [399.01, 5], [5, 299.01], [np.nan, 5]])
    assert inside(points, SIZE).tolist() == [True, True, False, False, False, False]


def test_normalised_has_one_in_the_corner() -> None:
    np.testing.assert_allclose(normalized(-2.5 * projective()), projective(), atol=1e-12)
    at_infinity = np.array([[1, 0, 0], [0, 1, 0], [0.1, 0, 0.0]])
    np.testing.assert_array_equal(normalized(at_infinity), at_infinity)


@pytest.mark.parametrize("H", [
    IDENTITY, projective(), translation(390, 0), similarity(180, 1), similarity(45, 3.9), similarity(10, 0.26)
], ids=["identity", "projective", "hardly overlapping", "upside down", "nearer", "farther"])
def test_a_camera_can_make(H: Homography) -> None:
    assert is_plausible(H, SIZE)


@pytest.mark.parametrize("H", [
    np.diag([-1.0, 1, 1]) @ translation(-399, 0),
    np.array([[1, 0, 0], [0, 1, 0], [-0.004, 0, 1]]),
    np.array([[1, 0, np.nan], [0, 1, 0], [0, 0, 1]]),
    np.array([[1, 0, np.inf], [0, 1, 0], [0, 0, 1]]),
    similarity(0, 4.1),
    similarity(0, 0.24),
    translation(400, 0),
    translation(0, -300),
    np.zeros((3, 3)),
    np.array([[1, 1, 0], [1, 1, 0], [0, 0, 1.0]]),
    np.array([[1, 0, 0], [0, 1, 0], [0.02, 0, 1]]),
], ids=["mirrored", "behind the camera", "nan", "infinite", "too near", "too far", "beside", "above", "zero",
        "singular", "too steep"])
def test_no_camera_can_make(H: Homography) -> None:
    assert not is_plausible(H, SIZE)
