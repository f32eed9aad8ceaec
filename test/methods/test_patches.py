"""Patches of which some determine no displacement."""

import numpy as np

from stab_ros.methods.patches import cut_patches


def test_patches_that_are_flat_or_striped_are_left_out() -> None:
    rng = np.random.default_rng(1)
    gray = np.full((60, 120), 128, np.uint8)
    gray[:, :40] = rng.integers(0, 256, (60, 40))
    gray[:, 80:] = rng.integers(0, 256, (60, 1))
    textured, flat, striped = np.array([[20, 30]]), np.array([[60, 30]]), np.array([[100, 30]])
    kept = cut_patches(gray, np.concatenate([flat, textured, striped]), 7)
    np.testing.assert_array_equal(kept.centres, textured)
    assert np.isfinite(kept.filters).all()


def test_a_patch_whose_gradients_are_all_parallel_is_left_out() -> None:
    x, y = np.meshgrid(np.arange(131), np.arange(64))
    ramp = (255 * (x + y) / (131 + 64)).astype(np.uint8)
    ramp[np.hypot(x - 65.5, y - 32) > 21] = 255  # as a round view has it
    assert len(cut_patches(ramp, np.array([[65, 22]]), 7)) == 0
