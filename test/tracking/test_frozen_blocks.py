"""Blocks that a codec copies from an earlier frame: they must not pass for ground that stands still."""

from __future__ import annotations

import numpy as np
import pytest
from flights import SIZE, fly

from stab_ros.core.geometry import sigma_px
from stab_ros.core.types import Correspondences, Gray
from stab_ros.parameters.engines import make_stabilizer
from stab_ros.synthetic.flight import Flight, preset
from stab_ros.tracking.frozen_blocks import CopiedBlocks, FrozenBlocks, no_better

BLOCK = 16


def textured(seed: int = 0) -> Gray:
    return np.random.default_rng(seed).integers(0, 256, (120, 160), np.uint8)


def test_what_equals_the_reference_or_the_frame_before_is_frozen() -> None:
    reference, places = textured(), np.array([[40.0, 40.0], [110.0, 40.0], [40.0, 90.0]])
    blocks = FrozenBlocks(reference, places)
    frame = textured(1)
    frame[20:60, 20:60] = reference[20:60, 20:60]
    assert blocks.find(frame).tolist() == [True, False, False]
    blocks.remember(frame, places)
    after = textured(2)
    after[20:60, 90:130] = frame[20:60, 90:130]
    assert blocks.find(after).tolist() == [False, True, False]


def test_noise_of_one_level_does_not_look_frozen() -> None:
    reference, places = textured() // 2 + 60, np.array([[40.0, 40.0], [110.0, 80.0]])
    noise = np.random.default_rng(1).normal(0, 1.0, reference.shape)
    noisy = np.clip(np.round(reference + noise), 0, 255).astype(np.uint8)
    assert not FrozenBlocks(reference, places).find(noisy).any()


def test_frozen_matches_claim_no_more_than_the_others() -> None:
    information = np.stack([np.eye(2) * value for value in (1e6, 100.0, 400.0, 50.0)])
    pairs = Correspondences(np.arange(4), np.zeros((4, 2)), np.zeros((4, 2)), information)
    capped = no_better(pairs, np.array([True, False, False, True]))
    assert capped.information[:, 0, 0].tolist() == [250.0, 100.0, 400.0, 50.0]


def lag_px(blocks: CopiedBlocks) -> float:
    return sigma_px(np.eye(3), blocks.covariance(np.zeros((8, 8)), np.eye(3)), SIZE)


def seen(blocks: CopiedBlocks, copied: int, step_px: float) -> None:
    """A frame that lies `step_px` from the last one, with so many of ten features copied."""
    blocks.add(np.arange(10) < copied, np.ones(10))
    blocks.moved(step_px)


def test_copied_blocks_lag_by_their_share_of_a_step() -> None:
    blocks = CopiedBlocks()
    for _ in range(5):
        seen(blocks, 0, 0.1)
    assert lag_px(blocks) == 0.0
    seen(blocks, 5, 0.1)
    assert lag_px(blocks) == pytest.approx(0.05)


def test_while_all_is_copied_the_lag_grows() -> None:
    blocks = CopiedBlocks()
    for _ in range(5):
        seen(blocks, 0, 0.1)
    for _ in range(10):
        seen(blocks, 10, 0.0)
    assert lag_px(blocks) == pytest.approx(1.0)
    seen(blocks, 0, 0.1)
    assert lag_px(blocks) < 0.1


def test_before_a_camera_that_stands_still_nothing_lags() -> None:
    blocks = CopiedBlocks()
    for _ in range(60):
        seen(blocks, 9, 0.0)
    assert lag_px(blocks) == 0.0
    assert blocks.much == pytest.approx(0.9)


def test_the_user_is_told_where_most_is_copied() -> None:
    flight = Flight(preset("kolubara"), SIZE, 40)
    plain, skipping = make_stabilizer({}), make_stabilizer({})
    fly(plain, flight)
    assert plain.copied_share is None
    last: list[Gray] = []

    def codec(number: int, image: Gray) -> Gray:
        last[:] = [image if number % 6 == 0 else np.where(np.arange(SIZE[0]) < 0.9 * SIZE[0], last[0], image)]
        return last[0].astype(np.uint8)

    fly(skipping, flight, codec)
    assert skipping.copied_share is not None
    assert skipping.copied_share > 0.6


def test_sigma_spans_what_copied_and_new_blocks_say() -> None:
    """Of each frame, a part is that of three frames before, as where a codec sees too little change."""
    flight = Flight(preset("kolubara"), SIZE, 40)
    images: list[Gray] = []
    stale = np.random.default_rng(2).random((SIZE[1] // BLOCK + 1, SIZE[0] // BLOCK + 1)) < 0.5
    mask = np.kron(stale, np.ones((BLOCK, BLOCK), bool))[: SIZE[1], : SIZE[0]]

    def codec(number: int, image: Gray) -> Gray:
        images.append(np.where(mask & (number % 4 > 0), images[-1] if images else image, image).astype(np.uint8))
        return images[-1]

    flown = fly(make_stabilizer({}), flight, codec)
    assert not flown.lost
    assert np.mean(flown.error_px[1:] <= 2 * flown.sigma_px[1:]) > 0.9
