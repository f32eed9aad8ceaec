"""Camera noise in the difference of two images, so that it can be subtracted from RMSD^2.

Noise is white, whereas texture decreases towards the finest wavelengths. The noise is therefore measured near the
Nyquist limit of both axes, by the eighth difference (Immerkaer 1996 uses the second), in blocks with little texture.
"""

from __future__ import annotations

import cv2
import numpy as np

from stab_ros.core.geometry import apply
from stab_ros.core.types import BoolArray, FloatArray, Gray, Homography, IdArray
from stab_ros.metrics.rmsd import cut

_BLOCK_PX = 33
_MOST_BLOCKS = 100
_CALM_SHARE = 0.25  # of all blocks, if that is fewer
_COARSE_PX = 3  # texture is measured on averages of so many px; a selection by the noise itself would be biased
_TAPS = np.array([1, -8, 28, -56, 70, -56, 28, -8, 1]) / np.sqrt(12870)  # the eighth difference, gain 1 for noise
_REACH = len(_TAPS) // 2
_NEIGHBOUR_CORRELATION = -11440 / 12870  # of filtered noise in neighbouring pixels: C(16, 7) / C(16, 8)
# The lower quartile over the blocks is used, because blocks above it may contain texture. Filtered noise has one degree
# of freedom per 13.2 pixels (the sum of its squared correlations). From this follows the ratio of the lower quartile of
# mean squares to their mean (Wilson and Hilferty 1931; -0.6745 is the quartile of the normal distribution).
_UNIT = 2 / (9 * (_BLOCK_PX - 2 * _REACH) ** 2 / 13.2)
_QUARTILE_TO_MEAN = (1 - _UNIT - 0.6745 * _UNIT**0.5) ** 3
_LINES = 5  # rows and columns of a window at which the interpolation weights are sampled


class NoiseGauge:
    """Measures white pixel noise in the blocks with the least texture in the reference."""

    def __init__(self, reference: Gray) -> None:
        """Chooses the blocks.

        Args:
            reference: (h, w) uint8.

        Raises:
            ValueError: the reference is smaller than one block of 33x33 px.
        """
        if min(reference.shape) < _BLOCK_PX:
            raise ValueError(f"an image of {reference.shape}, it must have at least {_BLOCK_PX}x{_BLOCK_PX} px")
        self._centres_px = _calm_blocks(reference)
        self._reference = cut(reference, self._centres_px, _BLOCK_PX)
        self._variance = _variance(self._reference)

    def sigma(self, gray: Gray) -> float:
        """Standard deviation of the noise, grey levels, of `gray` (h, w) uint8, of the reference's size.

        Texture at the finest wavelengths counts as noise. Clipped blocks, such as those in the border of a warped
        image, are ignored.
        """
        blocks = cut(gray, self._centres_px, _BLOCK_PX)
        return float(np.sqrt(_variance(_unclipped(blocks, blocks))))

    def share(self, current: Gray, ref_H_cur: Homography | None, centres_px: IdArray, window_px: int) -> FloatArray:
        """Contribution (P,) of noise to RMSD^2 between the reference and `current`, grey levels^2.

        It is limited to the difference of both images at the wavelengths of noise, because static fine texture is not
        noise.

        Args:
            current: (h, w) uint8.
            ref_H_cur: homography by which `current` was warped with linear interpolation, from an image with the noise
                of the reference; None if `current` was not warped.
            centres_px: (P, 2) centres of the windows, x and y.
            window_px: side of the windows, odd.
        """
        blocks = cut(current, self._centres_px, _BLOCK_PX)
        difference = _variance(_unclipped(blocks - self._reference, blocks))
        if ref_H_cur is None:
            both = self._variance + _variance(_unclipped(blocks, blocks))
            return np.full(len(centres_px), min(both, difference))
        kept = _kept_variance(ref_H_cur, self._centres_px, _BLOCK_PX, _NEIGHBOUR_CORRELATION).mean()
        variance = min(self._variance, difference / (1 + kept))
        return np.asarray(variance * (1 + interpolated_share(ref_H_cur, centres_px, window_px)))


def interpolated_share(ref_H_cur: Homography, centres_px: IdArray, window_px: int) -> FloatArray:
    """Share (P,), in (0, 1], of the variance of white noise that remains after a warp by `ref_H_cur`.

    For linear interpolation, as the mean over windows of `window_px` about `centres_px` (P, 2) of the warped image. An
    average of two pixels with weights 1 - f and f keeps (1 - f)^2 + f^2; it is 1 where pixels map to pixels.
    """
    return _kept_variance(ref_H_cur, centres_px, window_px, 0.0)


def _kept_variance(ref_H_cur: Homography, centres_px: IdArray, window_px: int, correlation: float) -> FloatArray:
    """Share (P,) of the variance after linear interpolation if neighbouring pixels have the given `correlation`."""
    span = np.linspace(-(window_px // 2), window_px // 2, _LINES)
    offsets = np.stack(np.meshgrid(span, span), axis=-1).reshape(-1, 2)
    places = (np.asarray(centres_px, np.float64)[:, None] + offsets).reshape(-1, 2)
    source = apply(np.linalg.inv(ref_H_cur), places)
    fraction = source - np.floor(source)
    kept = 1 - 2 * fraction * (1 - fraction) * (1 - correlation)
    return np.asarray(kept.prod(axis=1).reshape(len(centres_px), -1).mean(axis=1))


def _calm_blocks(reference: Gray) -> IdArray:
    """Centres (n, 2) of the blocks with the least texture; clipped ones only if there are no others."""
    rows, columns = (n // _BLOCK_PX for n in reference.shape)
    row, column = np.divmod(np.arange(rows * columns), columns)
    centres = np.stack([column, row], axis=1) * _BLOCK_PX + _BLOCK_PX // 2
    blocks = cut(reference, centres, _BLOCK_PX)
    side = _BLOCK_PX // _COARSE_PX
    coarse = blocks.reshape(-1, side, _COARSE_PX, side, _COARSE_PX).mean(axis=(2, 4))
    texture = np.where(_clipped(blocks), np.inf, coarse.var(axis=(1, 2)))
    count = min(_MOST_BLOCKS, max(1, int(_CALM_SHARE * len(centres))))
    return centres[np.sort(np.argsort(texture, kind="stable")[:count])]


def _variance(blocks: FloatArray) -> float:
    """Variance of the white noise in blocks (n, N, N), grey levels^2."""
    finest = cv2.sepFilter2D(blocks.reshape(-1, _BLOCK_PX), cv2.CV_32F, _TAPS, _TAPS).reshape(blocks.shape)
    inner = finest[:, _REACH:-_REACH, _REACH:-_REACH]  # the filter must not read outside the block
    return float(np.percentile(np.square(inner).mean(axis=(1, 2)), 25) / _QUARTILE_TO_MEAN)


def _unclipped(blocks: FloatArray, seen: FloatArray) -> FloatArray:
    """The blocks that are not clipped in the image `seen`; all if there are none."""
    sound = ~_clipped(seen)
    return blocks[sound] if sound.any() else blocks


def _clipped(blocks: FloatArray) -> BoolArray:
    """(n,) bool: whether a block has black or white pixels, which hide noise or belong to a border."""
    return np.asarray((blocks.min(axis=(1, 2)) < 1) | (blocks.max(axis=(1, 2)) > 254))
