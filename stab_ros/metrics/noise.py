"""How much of the difference of two pictures is the camera's noise, so that it can be taken out of RMSD^2.

Noise is white, textures fade towards the finest wavelengths; so it is read where both axes are near the Nyquist limit,
by the eighth difference (a stronger relative of Immerkaer's 1996 second one), and in blocks where the picture is calm.
"""

from __future__ import annotations

import cv2
import numpy as np

from stab_ros.core.geometry import apply
from stab_ros.core.types import BoolArray, FloatArray, Gray, Homography, IdArray
from stab_ros.metrics.rmsd import cut

_BLOCK_PX = 33
_MOST_BLOCKS = 100
_CALM_SHARE = 0.25  # of all blocks, where there are fewer
_COARSE_PX = 3  # calm is judged by averages over so many pixels: choosing by the noise itself would bias it
_TAPS = np.array([1, -8, 28, -56, 70, -56, 28, -8, 1]) / np.sqrt(12870)  # the eighth difference, gain 1 for noise
_REACH = len(_TAPS) // 2
_NEIGHBOURS = -11440 / 12870  # correlation of neighbouring pixels of noise behind it: C(16, 7) / C(16, 8)
# The lower quartile over the blocks counts: those above may hold texture. Noise behind the filter has one degree of
# freedom in 13.2 pixels (the squares of its correlations add up to that), which tells by how much the lower quartile
# of mean squares lies below their mean (Wilson and Hilferty 1931; -0.6745 is the quartile of a normal distribution).
_UNIT = 2 / (9 * (_BLOCK_PX - 2 * _REACH) ** 2 / 13.2)
_QUARTILE_TO_MEAN = (1 - _UNIT - 0.6745 * _UNIT**0.5) ** 3
_LINES = 5  # rows and columns of a window at which the interpolation is looked at


class NoiseGauge:
    """Measures white pixel noise in the blocks where the reference is calmest, chosen once."""

    def __init__(self, reference: Gray) -> None:
        """reference: (h, w) uint8.

        Raises:
            ValueError: it is smaller than one block of 33x33 px.
        """
        if min(reference.shape) < _BLOCK_PX:
            raise ValueError(f"a picture of {reference.shape}, it must have at least {_BLOCK_PX}x{_BLOCK_PX} px")
        self._centres_px = _calm_blocks(reference)
        self._reference = cut(reference, self._centres_px, _BLOCK_PX)
        self._variance = _variance(self._reference)

    def sigma(self, gray: Gray) -> float:
        """Standard deviation, grey levels, of the noise of `gray`, (h, w) uint8, of the reference's size.

        What the finest wavelengths hold of the texture counts as noise. Blocks that are clipped, as those beyond the
        border of a warped picture are, do not count.
        """
        blocks = cut(gray, self._centres_px, _BLOCK_PX)
        return float(np.sqrt(_variance(_sound(blocks, blocks))))

    def share(self, current: Gray, ref_H_cur: Homography | None, centres_px: IdArray, window_px: int) -> FloatArray:
        """(P,) grey levels^2: what noise adds to RMSD^2 of the reference and `current` in windows about `centres_px`.

        With `ref_H_cur`, `current` was warped by it, linearly interpolated, from a picture as noisy as the reference;
        without, it is taken as it is. Never more than the difference of both pictures holds at the wavelengths of
        noise: texture that keeps its place is no noise, however fine it is.
        """
        blocks = cut(current, self._centres_px, _BLOCK_PX)
        difference = _variance(_sound(blocks - self._reference, blocks))
        if ref_H_cur is None:
            both = self._variance + _variance(_sound(blocks, blocks))
            return np.full(len(centres_px), min(both, difference))
        left = _left(ref_H_cur, self._centres_px, _BLOCK_PX, _NEIGHBOURS).mean()
        variance = min(self._variance, difference / (1 + left))
        return np.asarray(variance * (1 + interpolated_share(ref_H_cur, centres_px, window_px)))


def interpolated_share(ref_H_cur: Homography, centres_px: IdArray, window_px: int) -> FloatArray:
    """(P,) in (0, 1]: the variance that white noise keeps when a picture is warped by `ref_H_cur`.

    For linear interpolation, mean over windows of `window_px` about `centres_px` (P, 2) of the warped picture. An
    average of two pixels with weights 1 - f and f keeps (1 - f)^2 + f^2; it is 1 where pixels fall on pixels.
    """
    return _left(ref_H_cur, centres_px, window_px, 0.0)


def _left(ref_H_cur: Homography, centres_px: IdArray, window_px: int, correlation: float) -> FloatArray:
    """(P,) share of the variance left by linear interpolation if neighbouring pixels have that `correlation`."""
    span = np.linspace(-(window_px // 2), window_px // 2, _LINES)
    offsets = np.stack(np.meshgrid(span, span), axis=-1).reshape(-1, 2)
    places = (np.asarray(centres_px, np.float64)[:, None] + offsets).reshape(-1, 2)
    source = apply(np.linalg.inv(ref_H_cur), places)
    fraction = source - np.floor(source)
    kept = 1 - 2 * fraction * (1 - fraction) * (1 - correlation)
    return np.asarray(kept.prod(axis=1).reshape(len(centres_px), -1).mean(axis=1))


def _calm_blocks(reference: Gray) -> IdArray:
    """(n, 2) centres of the blocks with the least texture, but not of clipped ones if there are others."""
    rows, columns = (n // _BLOCK_PX for n in reference.shape)
    row, column = np.divmod(np.arange(rows * columns), columns)
    centres = np.stack([column, row], axis=1) * _BLOCK_PX + _BLOCK_PX // 2
    blocks = cut(reference, centres, _BLOCK_PX)
    side = _BLOCK_PX // _COARSE_PX
    coarse = blocks.reshape(-1, side, _COARSE_PX, side, _COARSE_PX).mean(axis=(2, 4))
    unrest = np.where(_clipped(blocks), np.inf, coarse.var(axis=(1, 2)))
    count = min(_MOST_BLOCKS, max(1, int(_CALM_SHARE * len(centres))))
    return centres[np.sort(np.argsort(unrest, kind="stable")[:count])]


def _variance(blocks: FloatArray) -> float:
    """Of the white noise in blocks (n, N, N)."""
    finest = cv2.sepFilter2D(blocks.reshape(-1, _BLOCK_PX), cv2.CV_32F, _TAPS, _TAPS).reshape(blocks.shape)
    inner = finest[:, _REACH:-_REACH, _REACH:-_REACH]  # what the filter reads stays within the block
    return float(np.percentile(np.square(inner).mean(axis=(1, 2)), 25) / _QUARTILE_TO_MEAN)


def _sound(blocks: FloatArray, seen: FloatArray) -> FloatArray:
    """Those of the blocks that are not clipped in the picture `seen`; all where there are none."""
    sound = ~_clipped(seen)
    return blocks[sound] if sound.any() else blocks


def _clipped(blocks: FloatArray) -> BoolArray:
    """(n,) bool: black or white pixels hide noise, and a border is no texture."""
    return np.asarray((blocks.min(axis=(1, 2)) < 1) | (blocks.max(axis=(1, 2)) > 254))
