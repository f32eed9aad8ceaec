"""What a decoder delivers that lost its thread: one garbage picture, or blocks that stay as they were."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import cv2
import numpy as np

from lies.draw import Recipe
from stab_ros.core.types import BoolArray, Gray, IdArray

_BLOCK = 16  # px, of a macroblock


def garbage_frames(recipe: Recipe) -> BoolArray:
    """(n,) bool: the frames that show garbage."""
    bad = np.zeros(recipe.frames, bool)
    if recipe.fault == "garbage_first":
        bad[0] = True
    if recipe.fault == "garbage_early":
        bad[int(np.random.default_rng([recipe.seed, 6]).integers(1, 24))] = True
    return bad


def shown_poses(recipe: Recipe) -> IdArray:
    """(n,) int64: whose pose each frame shows; some cameras and recorders repeat frames."""
    frame = np.arange(recipe.frames)
    if recipe.fault != "repeated":
        return frame
    rng = np.random.default_rng([recipe.seed, 9])
    held = rng.random(recipe.frames) < rng.uniform(0.1, 0.6)
    held[0] = False
    return np.maximum.accumulate(np.where(held, 0, frame))


def decoded(recipe: Recipe, pictures: Sequence[Gray]) -> list[Gray]:
    """The pictures of a flight as a decoder with the recipe's fault delivers them."""
    rng = np.random.default_rng([recipe.seed, 8])
    if recipe.fault.startswith("garbage"):
        spoil = _SPOILT[int(rng.integers(len(_SPOILT)))]
        return [spoil(picture, rng) if bad else picture
                for picture, bad in zip(pictures, garbage_frames(recipe), strict=True)]
    if recipe.fault.startswith("frozen"):
        return _frozen(pictures, rng, recipe.fault == "frozen_reference")
    return list(pictures)


def _frozen(pictures: Sequence[Gray], rng: np.random.Generator, to_first: bool) -> list[Gray]:
    """Blocks that differ least from the frame before, or from the first one, are copied from there."""
    share, begin = rng.uniform(0.15, 0.75), int(rng.integers(1, 20))
    end, shown = begin + int(rng.integers(15, 60)), [pictures[0]]
    for k, picture in enumerate(pictures[1:], 1):
        source = shown[0] if to_first else shown[-1]
        shown.append(_skipped(picture, source, share) if begin <= k < end else picture)
    return shown


def _skipped(picture: Gray, source: Gray, share: float) -> Gray:
    change = cv2.absdiff(picture, source)
    blocks = (-(-picture.shape[1] // _BLOCK), -(-picture.shape[0] // _BLOCK))
    mean = cv2.resize(change, blocks, interpolation=cv2.INTER_AREA)
    still = (mean <= min(np.quantile(mean, share), 4)).astype(np.uint8)
    mask = np.kron(still, np.ones((_BLOCK, _BLOCK), np.uint8))[: picture.shape[0], : picture.shape[1]]
    return np.where(mask > 0, source, picture)


def _shifted_blocks(picture: Gray, rng: np.random.Generator) -> Gray:
    """Stripes of blocks, each from elsewhere."""
    spoilt = np.roll(picture, (40, 90), (0, 1))
    for top in range(0, len(picture), 4 * _BLOCK):
        stripe = slice(top, top + 4 * _BLOCK)
        spoilt[stripe] = np.roll(spoilt[stripe], int(rng.integers(30, 200)), 1)
    return spoilt


def _half_missing(picture: Gray, rng: np.random.Generator) -> Gray:
    spoilt = picture.copy()
    spoilt[int(rng.uniform(0.4, 0.6) * len(picture)) :] = 128
    return spoilt


_SPOILT: tuple[Callable[[Gray, np.random.Generator], Gray], ...] = (
    _shifted_blocks,
    lambda picture, _rng: np.ascontiguousarray(picture[::-1]),
    lambda picture, _rng: np.asarray(cv2.GaussianBlur(picture, (0, 0), 8), np.uint8),
    lambda picture, _rng: np.full_like(picture, 128),
    _half_missing,
)
