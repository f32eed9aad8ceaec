"""The ratio descriptor of SAR-SIFT (Dellinger et al. 2015, section IV): GLOH over gradients by ratio.

The support region is a disc and two rings of eight sectors each (GLOH, Mikolajczyk and Schmid 2005). Each of these 17
spatial bins has a histogram of eight gradient directions. Samples are alpha apart, because the gradient at scale alpha
holds no finer detail.
"""

from __future__ import annotations

import numpy as np

from stab_ros.core.types import Float32Array, FloatArray, IdArray
from stab_ros.methods._roewa import RatioGradient

DIRECTIONS, SECTORS = 8, 8
LENGTH = (1 + 2 * SECTORS) * DIRECTIONS
_RADIUS = 12  # of the support region, in alpha
_RINGS = (0.25, 0.73)  # outer radii of the disc and of the first ring, as shares of the radius
_ORIENTATION_RADIUS = 6  # of the region of the orientation histogram, in alpha
_ORIENTATIONS = 36
_SECOND_PEAK = 0.8
_CLIP = 0.2
_CHUNK = 256  # key points described at a time


def _offsets(radius: int) -> FloatArray:
    """Integer offsets (n, 2) within a circle."""
    span = np.arange(-radius, radius + 1.0)
    x, y = (a.ravel() for a in np.meshgrid(span, span))
    return np.asarray(np.stack([x, y], axis=1)[np.hypot(x, y) <= radius])


def _spatial_bins() -> IdArray:
    """Spatial bin (0 to 16) of each offset within the support region."""
    x, y = _offsets(_RADIUS).T
    ring = np.searchsorted(np.array(_RINGS) * _RADIUS, np.hypot(x, y))
    sector = np.floor(np.arctan2(y, x) / (2 * np.pi) * SECTORS + 0.5).astype(np.int64) % SECTORS
    return np.asarray(np.where(ring == 0, 0, 1 + (ring - 1) * SECTORS + sector))


_MEMBERS = (np.arange(1 + 2 * SECTORS)[:, None] == _spatial_bins()).astype(np.float32)


def orientations(scale: RatioGradient, px: FloatArray) -> tuple[IdArray, FloatArray]:
    """Index of the key point and orientation in rad, once for each peak of each key point's orientation histogram.

    px: (n, 2) key points, px.
    """
    right, down = _sampled(scale, px, _offsets(_ORIENTATION_RADIUS) * scale.alpha_px)
    orientation = np.floor(np.arctan2(down, right) / (2 * np.pi) * _ORIENTATIONS).astype(np.int64) % _ORIENTATIONS
    slot = np.arange(len(px))[:, None] * _ORIENTATIONS + orientation
    votes = np.bincount(slot.ravel(), np.hypot(right, down).ravel(), len(px) * _ORIENTATIONS).astype(np.float64)
    smooth = _smoothed(votes.reshape(-1, _ORIENTATIONS))
    before, after = np.roll(smooth, 1, axis=1), np.roll(smooth, -1, axis=1)
    peak = (smooth > before) & (smooth >= after) & (smooth >= _SECOND_PEAK * smooth.max(axis=1, keepdims=True))
    which, k = np.nonzero(peak)
    low, middle, high = before[peak], smooth[peak], after[peak]
    offset = (high - low) / np.maximum(2 * (2 * middle - low - high), 1e-12)
    return which, (k + 0.5 + np.clip(offset, -0.5, 0.5)) * 2 * np.pi / _ORIENTATIONS


def _smoothed(histogram: FloatArray) -> FloatArray:
    """Histograms (n, bins), smoothed circularly by [1 4 6 4 1] / 16."""
    kernel = np.array([1, 4, 6, 4, 1]) / 16
    shifted = np.stack([np.roll(histogram, shift, axis=1) for shift in range(-2, 3)])
    return np.asarray(np.tensordot(kernel, shifted, axes=1))


def describe(scale: RatioGradient, px: FloatArray, angle: FloatArray) -> Float32Array:
    """Descriptors (n, 136) float32 of unit length for key points (n, 2), px, with orientations `angle` (n,), rad."""
    parts = [_described(scale, px[k : k + _CHUNK], angle[k : k + _CHUNK]) for k in range(0, len(px), _CHUNK)]
    return np.concatenate([np.empty((0, LENGTH), np.float32), *parts])


def _described(scale: RatioGradient, px: FloatArray, angle: FloatArray) -> Float32Array:
    cos, sin = np.cos(angle), np.sin(angle)
    turned = np.moveaxis(np.array([[cos, sin], [-sin, cos]]), 2, 0)  # (n, 2, 2); rows: the rotated x and y axes
    right, down = _sampled(scale, px, scale.alpha_px * (_offsets(_RADIUS) @ turned))
    direction = (np.arctan2(down, right) - angle[:, None]) / (2 * np.pi) * DIRECTIONS
    lower = np.floor(direction)
    size, share = np.hypot(right, down), direction - lower
    votes = np.zeros((DIRECTIONS, *size.shape), np.float32)
    for k in range(DIRECTIONS):  # linear interpolation between the two nearest directions
        votes[k] = size * ((lower % DIRECTIONS == k) * (1 - share) + ((lower + 1) % DIRECTIONS == k) * share)
    return _normalized(np.einsum("ps,dns->npd", _MEMBERS, votes, optimize=True).reshape(len(px), -1))


def _sampled(scale: RatioGradient, px: FloatArray, offsets: FloatArray) -> tuple[Float32Array, Float32Array]:
    """Gradient components (n, s) at the pixels nearest to each key point (n, 2) plus offsets; 0 outside the image."""
    at = np.round(px[:, None] + offsets).astype(np.int64)
    height, width = scale.right.shape
    inside = (at >= 0).all(axis=2) & (at[..., 0] < width) & (at[..., 1] < height)
    column, row = np.clip(at[..., 0], 0, width - 1), np.clip(at[..., 1], 0, height - 1)
    return scale.right[row, column] * inside, scale.down[row, column] * inside


def _normalized(descriptor: Float32Array) -> Float32Array:
    """Unit length, clipped and normalized again (Lowe 2004, section 6.1)."""
    for most in (_CLIP, np.inf):
        length = np.linalg.norm(descriptor, axis=1, keepdims=True)
        descriptor = np.minimum(descriptor / np.maximum(length, 1e-12), np.float32(most))
    return np.asarray(descriptor)
