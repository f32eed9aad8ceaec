"""Seamless random textures by spectral shaping, and how the kernels of the renderer read them."""

from __future__ import annotations

from typing import TypeAlias

import numba
import numpy as np
from numpy.typing import NDArray

Texture: TypeAlias = NDArray[np.float32]  # (TILE, TILE), mean 0, standard deviation 1, repeats without a seam

TILE = 1024  # a power of two: the kernels wrap by masking


def natural_texture(key: list[int], falloff: float, largest_px: float, stretch: float = 1.0) -> Texture:
    """Noise of amplitude f^-falloff above 1/largest_px, as natural surfaces have it (Field 1987); nothing finer than
    two texels is left. stretch > 1 makes it longer along y than along x. key: seed of the generator.
    """
    fy, fx = np.meshgrid(np.fft.fftfreq(TILE) * stretch, np.fft.rfftfreq(TILE), indexing="ij")
    frequency = np.hypot(fx, fy)
    amplitude = (frequency + 1.0 / largest_px) ** -falloff * np.exp(-((frequency / 0.3) ** 4))
    amplitude[0, 0] = 0.0
    noise = np.fft.rfft2(np.random.default_rng(key).standard_normal((TILE, TILE)))
    shaped = np.fft.irfft2(noise * amplitude, s=(TILE, TILE))
    return np.asarray(shaped / shaped.std(), dtype=np.float32)


@numba.njit(cache=True, inline="always")
def sample_texture(texture, x, y):  # type: ignore[no-untyped-def]
    """The texture at (x, y) texels, bilinear, repeated in both directions."""
    left, top = int(np.floor(x)), int(np.floor(y))
    fx, fy = np.float32(x - left), np.float32(y - top)
    j0, i0 = left & (TILE - 1), top & (TILE - 1)
    j1, i1 = (j0 + 1) & (TILE - 1), (i0 + 1) & (TILE - 1)
    upper = texture[i0, j0] + fx * (texture[i0, j1] - texture[i0, j0])
    lower = texture[i1, j0] + fx * (texture[i1, j1] - texture[i1, j0])
    return upper + fy * (lower - upper)


@numba.njit(cache=True, inline="always")
def smooth_step(low, high, x):  # type: ignore[no-untyped-def]
    """0 below `low`, 1 above `high`, smooth between."""
    t = min(max((x - low) / (high - low), 0.0), 1.0)
    return t * t * (3.0 - 2.0 * t)
