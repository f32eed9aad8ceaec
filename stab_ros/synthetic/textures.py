"""Periodic random textures by spectral shaping, and their sampling in the kernels of the renderer."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from stab_ros.core.kernels import lazy_kernel

Texture: TypeAlias = NDArray[np.float32]  # (TILE, TILE), periodic, mean 0, standard deviation 1

TILE = 1024  # a power of two: the kernels wrap by masking


def natural_texture(key: list[int], falloff: float, largest_texels: float, stretch: float = 1.0,
                    cut: float = 0.3) -> Texture:
    """Noise with the spectrum of natural surfaces, amplitude f^-falloff (Field 1987): (1024, 1024) float32.

    Args:
        key: seed.
        falloff: exponent of the amplitude spectrum.
        largest_texels: wavelength above which the spectrum is constant.
        stretch: below 1, the pattern is elongated along x; above 1, along y.
        cut: highest spatial frequency, 1/texel; the finest wavelength is then about three texels.
    """
    fy, fx = np.meshgrid(np.fft.fftfreq(TILE) * stretch, np.fft.rfftfreq(TILE), indexing="ij")
    frequency = np.hypot(fx, fy)
    amplitude = (frequency + 1.0 / largest_texels) ** -falloff * np.exp(-((frequency / cut) ** 4))
    amplitude[0, 0] = 0.0
    noise = np.fft.rfft2(np.random.default_rng(key).standard_normal((TILE, TILE)))
    shaped = np.fft.irfft2(noise * amplitude, s=(TILE, TILE))
    return np.asarray(shaped / shaped.std(), dtype=np.float32)


@lazy_kernel(inline="always")
def sample_texture(texture: Texture, x: float, y: float) -> np.float32:
    """The texture at (x, y), texels, by bilinear interpolation with periodic continuation."""
    left, top = int(np.floor(x)), int(np.floor(y))
    fx, fy = np.float32(x - left), np.float32(y - top)
    j0, i0 = left & (TILE - 1), top & (TILE - 1)
    j1, i1 = (j0 + 1) & (TILE - 1), (i0 + 1) & (TILE - 1)
    upper = texture[i0, j0] + fx * (texture[i0, j1] - texture[i0, j0])
    lower = texture[i1, j0] + fx * (texture[i1, j1] - texture[i1, j0])
    return np.float32(upper + fy * (lower - upper))


@lazy_kernel(inline="always")
def smooth_step(low: float, high: float, x: float) -> float:
    """Smooth step function: 0 below `low`, 1 above `high`."""
    t = min(max((x - low) / (high - low), 0.0), 1.0)
    return t * t * (3.0 - 2.0 * t)
