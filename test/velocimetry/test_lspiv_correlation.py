"""Correlations of blocks beside plain sums, and the variances that windows side by side tell."""

from __future__ import annotations

import numpy as np
import pytest
from moving_texture_lspiv import texture
from scipy.ndimage import map_coordinates

from stab_ros.core.types import FloatArray
from stab_ros.velocimetry.correlation_blocks import as_spline, block_correlations, from_spline
from stab_ros.velocimetry.correlation_scatter import variance_factor

BLOCK_PX, BLOCKS = 12, (6, 8)
STEP_PX = 24.0


def pictures() -> tuple[FloatArray, FloatArray]:
    """Of one texture, the second moved by a field that shears, and with other noise."""
    whole = texture(np.random.default_rng(1))
    y, x = np.mgrid[: BLOCK_PX * BLOCKS[0], : BLOCK_PX * BLOCKS[1]].astype(float)
    first = map_coordinates(whole, [y + 50, x + 50], order=5)
    return first.astype(np.float32), map_coordinates(whole, [y + 50.4, x + 48.7], order=5).astype(np.float32)


def field(dx: float, dy: float) -> FloatArray:
    """A field of displacements that is the same everywhere."""
    return np.tile([dx, dy], (5, 6, 1))


def correlated(first: FloatArray, second: FloatArray, shift_px: FloatArray) -> FloatArray:
    return block_correlations(as_spline(first), as_spline(second), shift_px, -0.5, STEP_PX, BLOCK_PX,
                              np.ones(BLOCKS, bool))


def test_a_spline_goes_through_its_picture() -> None:
    first, _ = pictures()
    np.testing.assert_allclose(from_spline(as_spline(first)), first, atol=1e-3)


def test_sums_are_those_of_the_products() -> None:
    first, second = pictures()
    found = correlated(first, second, field(0.0, 0.0))
    n, at = BLOCK_PX, (slice(2 * BLOCK_PX, 3 * BLOCK_PX), slice(3 * BLOCK_PX, 4 * BLOCK_PX))
    for lag, value in enumerate(found[2, 3, :9].tolist()):
        move = lag // 3 - 1, lag % 3 - 1
        there = first * np.roll(second, (-move[0], -move[1]), axis=(0, 1))
        here = np.roll(first, move, axis=(0, 1)) * second
        assert value == pytest.approx((there[at].sum() + here[at].sum()) / (2 * n * n), abs=2e-3)
    assert found[2, 3, 9] == pytest.approx((first[at] ** 2 + second[at] ** 2).mean() / 2, abs=2e-3)


def test_pictures_drawn_along_their_displacement_are_alike() -> None:
    first, second = pictures()
    inner = correlated(first, second, field(1.3, -0.4))[1:-1, 1:-1]
    assert (inner[:, :, 4] > 0.995 * inner[:, :, 9]).all()
    np.testing.assert_allclose(inner[:, :, 3], inner[:, :, 5], atol=0.02)  # the peak is in the middle


def test_blocks_that_are_not_wanted_stay_zero() -> None:
    first, second = (as_spline(one) for one in pictures())
    wanted = np.zeros(BLOCKS, bool)
    wanted[2, 1] = wanted[2, 6] = True
    found = block_correlations(first, second, field(1.3, -0.4), -0.5, STEP_PX, BLOCK_PX, wanted)
    every = correlated(*pictures(), field(1.3, -0.4))
    np.testing.assert_allclose(found[wanted], every[wanted], atol=1e-6)
    assert not found[~wanted].any()


@pytest.mark.parametrize("factor", [0.25, 1.0, 4.0])
def test_the_variance_factor_is_that_of_the_errors(factor: float) -> None:
    rng, shape = np.random.default_rng(2), (30, 40, 2)
    linear = np.add.outer(np.arange(30), 0.3 * np.arange(40))[:, :, None]
    values = linear + rng.normal(0, np.sqrt(factor) * 0.1, shape)
    assert variance_factor(values, np.full(shape, 0.01), 2) == pytest.approx(factor, rel=0.15)
    assert variance_factor(np.full(shape, np.nan), np.ones(shape), 2, 1.7) == 1.7
