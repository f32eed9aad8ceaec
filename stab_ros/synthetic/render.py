"""Kernels of the renderer: the image of the ground and the water at one instant.

A pixel of dry ground is the mean of 2 x 2 samples a quarter of a pixel from its centre, as in an area average of an
image of twice the size. Sampling is by splines in double precision, because OpenCV's warps round coordinates to
1/32 px.
"""

from __future__ import annotations

from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from stab_ros.core.kernels import lazy_kernel
from stab_ros.core.types import BoolArray, FloatArray, Gray, Homography, Image
from stab_ros.synthetic.terrain import COARSE
from stab_ros.synthetic.textures import Texture, sample_texture

FloatImage: TypeAlias = NDArray[np.float32]  # grey levels, before noise and rounding

_FINE_WAVES, _BROAD_WAVES = 0.5, 0.17  # texels of the texture per texel of ground
_COLORLESS = np.float32(225)  # grey level from which on colours are white: control points, glitter


@lazy_kernel(inline="always")
def _weights(t: np.float32) -> tuple[np.float32, np.float32, np.float32]:
    """Weights of three neighbours in a quadratic B-spline at t in [-1/2, 1/2] from the middle one."""
    half = np.float32(0.5)
    return half * (half - t) * (half - t), np.float32(0.75) - t * t, half * (half + t) * (half + t)


@lazy_kernel(inline="always")
def _sample_spline(image: Gray, x: float, y: float) -> np.float32:
    """Value at (x, y) of the spline surface with the coefficients `image` (h, w) uint8."""
    column = min(max(int(x + 0.5), 1), image.shape[1] - 2)
    row = min(max(int(y + 0.5), 1), image.shape[0] - 2)
    a0, a1, a2 = _weights(np.float32(x - column))
    b0, b1, b2 = _weights(np.float32(y - row))
    total = np.float32(0)
    for i, weight in ((row - 1, b0), (row, b1), (row + 1, b2)):
        left, middle, right = image[i, column - 1], image[i, column], image[i, column + 1]
        total += weight * (a0 * np.float32(left) + a1 * np.float32(middle) + a2 * np.float32(right))
    return total


@lazy_kernel(inline="always")
def sample_linear(image: Image, x: float, y: float) -> np.float32:
    """Value at (x, y) of an image (h, w), linear between its pixels and constant beyond its border."""
    left = min(max(int(np.floor(x)), 0), image.shape[1] - 2)
    top = min(max(int(np.floor(y)), 0), image.shape[0] - 2)
    fx = np.float32(min(max(x - left, 0.0), 1.0))
    fy = np.float32(min(max(y - top, 0.0), 1.0))
    a, b = np.float32(image[top, left]), np.float32(image[top, left + 1])
    c, d = np.float32(image[top + 1, left]), np.float32(image[top + 1, left + 1])
    upper = a + fx * (b - a)
    return upper + fy * (c + fx * (d - c) - upper)


@lazy_kernel(inline="always")
def texel(H: Homography, u: float, v: float) -> tuple[float, float]:
    """Where the homography H (3, 3) maps (u, v)."""
    k = 1 / (H[2, 0] * u + H[2, 1] * v + H[2, 2])
    return (H[0, 0] * u + H[0, 1] * v + H[0, 2]) * k, (H[1, 0] * u + H[1, 1] * v + H[1, 2]) * k


@lazy_kernel()
def render_gray(size: tuple[int, int], texel_H_image: Homography, brightness: Gray, water: Gray,
                surface: Surface) -> FloatImage:
    """Grey levels (h, w) float32 of ground and water, without noise.

    Args:
        size: width and height, px.
        texel_H_image: (3, 3), from pixels to texels.
        brightness: (h, w) uint8, see `GroundTexture`.
        water: (h, w) uint8, see `GroundTexture`.
        surface: of the water.
    """
    image = np.empty((size[1], size[0]), np.float32)
    for v in range(size[1]):
        for u in range(size[0]):
            tx, ty = texel(texel_H_image, u, v)
            wet = sample_linear(water, tx, ty) / np.float32(255)
            level = np.float32(0)
            if wet < 1:
                level += (1 - wet) * land_level(texel_H_image, brightness, u, v)
            if wet > 0:
                level += wet * _water_level(surface, u, v, tx, ty)
            image[v, u] = level
    return image


@lazy_kernel(inline="always")
def land_level(texel_H_image: Homography, brightness: Gray, u: int, v: int) -> np.float32:
    """Grey level of the dry ground at pixel (u, v)."""
    total = np.float32(0)
    for dv in (-0.25, 0.25):
        for du in (-0.25, 0.25):
            tx, ty = texel(texel_H_image, u + du, v + dv)
            total += _sample_spline(brightness, tx, ty)
    return total * np.float32(0.25)


class Surface(NamedTuple):
    """The water surface at one instant.

    Attributes:
        flow: (h/8, w/8, 2) float32 velocity, texels/s.
        waves: texture of the ripples.
        lives: (2, 4) age, s, weight and texture offset x, y of two generations of ripples.
        glint: (3,) centre x, y and radius of the sun glint, px.
        contrast: of the ripples; 1 for a calm river.
    """

    flow: NDArray[np.float32]
    waves: Texture
    lives: FloatArray
    glint: FloatArray
    contrast: float


@lazy_kernel(inline="always")
def _water_level(surface: Surface, u: int, v: int, tx: float, ty: float) -> np.float32:
    """Grey level of the water: two generations of ripples, advected and cross-faded, and sun glint."""
    flow, waves, lives, glint, contrast = surface
    along = sample_linear(flow[:, :, 0], tx / COARSE, ty / COARSE)
    across = sample_linear(flow[:, :, 1], tx / COARSE, ty / COARSE)
    ripple = np.float32(0)
    for k in range(2):
        if lives[k, 1] == 0:
            continue
        x = tx - along * lives[k, 0] + lives[k, 2]
        y = ty - across * lives[k, 0] + lives[k, 3]
        fine = sample_texture(waves, x * _FINE_WAVES, y * _FINE_WAVES)
        broad = sample_texture(waves, x * _BROAD_WAVES, y * _BROAD_WAVES)
        ripple += np.float32(lives[k, 1]) * (np.float32(0.6) * fine + np.float32(0.8) * broad)
    shine = np.float32(np.exp(-((u - glint[0]) ** 2 + (v - glint[1]) ** 2) / glint[2] ** 2))
    glitter = max(ripple - np.float32(1.2), np.float32(0))
    return np.float32(78) + np.float32(9 * contrast) * ripple + shine * (np.float32(14) + np.float32(60) * glitter)


@lazy_kernel()
def water_mask(size: tuple[int, int], texel_H_image: Homography, water: Gray) -> BoolArray:
    """Mask (h, w) bool of the pixels that show any water."""
    mask = np.zeros((size[1], size[0]), np.bool_)
    for v in range(size[1]):
        for u in range(size[0]):
            tx, ty = texel(texel_H_image, u, v)
            mask[v, u] = sample_linear(water, tx, ty) > 0
    return mask


@lazy_kernel()
def add_tracers(image: FloatImage, tracers: FloatArray) -> None:
    """Adds Gaussian tracer particles (n, 4): x, y and sigma, px, and amplitude, grey levels."""
    for k in range(len(tracers)):
        x, y, sigma, level = tracers[k]
        reach = 3 * sigma + 1
        for v in range(max(int(y - reach), 0), min(int(y + reach) + 2, image.shape[0])):
            for u in range(max(int(x - reach), 0), min(int(x + reach) + 2, image.shape[1])):
                near = np.exp(-((u - x) ** 2 + (v - y) ** 2) / (2 * sigma * sigma))
                image[v, u] += np.float32(level * near)


@lazy_kernel()
def colored(image: FloatImage, texel_H_image: Homography, tint: NDArray[np.float32]) -> FloatImage:
    """Colour image (h, w, 3) float32 bgr from grey levels and the tint of the ground."""
    rows, columns = image.shape
    result = np.empty((rows, columns, 3), np.float32)
    for v in range(rows):
        for u in range(columns):
            tx, ty = texel(texel_H_image, u, v)
            level = image[v, u]
            share = min(max((_COLORLESS - level) / np.float32(80), np.float32(0)), np.float32(1))
            for c in range(3):
                factor = sample_linear(tint[:, :, c], tx / COARSE, ty / COARSE) - np.float32(1)
                result[v, u, c] = level * (np.float32(1) + share * factor)
    return result


@lazy_kernel()
def quantised(image: FloatImage, noise: FloatImage, gain: np.float32, offset: np.float32) -> Image:
    """Gain * image + offset + noise, rounded to uint8; all arrays are flat float32."""
    result = np.empty(len(image), np.uint8)
    for i in range(len(image)):
        level = gain * image[i] + offset + noise[i] + np.float32(0.5)
        result[i] = int(min(max(level, np.float32(0)), np.float32(255)))
    return result
