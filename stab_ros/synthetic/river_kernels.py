"""Kernels of the renderer of moving rivers: texture that drifts in patches, and what else is seen of the water."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from stab_ros.core.kernels import lazy_kernel
from stab_ros.core.types import Float32Array, FloatArray, Gray, Homography
from stab_ros.synthetic.render import FloatImage, land_level, sample_linear, texel
from stab_ros.synthetic.terrain import COARSE, Layout, depth_m
from stab_ros.synthetic.textures import Texture, sample_texture

_WATER_LEVEL = np.float32(78)
_SPARKLE_FROM = np.float32(0.9)  # standard deviations of the texture
_FOAM_FROM = np.float32(0.9)


class Patches(NamedTuple):
    """N patches of texture.

    Attributes:
        place_px: (N, 2).
        patch_A_image: (N, 2, 2), from offsets in the image, px, to shares of a patch's radius.
        reach_px: (N, 2), half width and half height of a patch in the image.
        weight: (N,).
        offset: (N, 2), where in the texture, texels.
        radius_texels: of a patch in the texture.
    """

    place_px: FloatArray
    patch_A_image: FloatArray
    reach_px: FloatArray
    weight: FloatArray
    offset: FloatArray
    radius_texels: float


@lazy_kernel()
def draw_patches(texture: Texture, patches: Patches, total: FloatImage, power: FloatImage,
                 foam: FloatImage) -> None:
    """Adds patches to `total`, the squares of their weights to `power`, and their foam to `foam`, (h, w) float32."""
    place, A, reach, weights, offset, radius = patches
    rows, columns = total.shape
    for k in range(len(weights)):
        x, y = place[k, 0], place[k, 1]
        left, right = max(int(np.ceil(x - reach[k, 0])), 0), min(int(x + reach[k, 0]), columns - 1)
        for v in range(max(int(np.ceil(y - reach[k, 1])), 0), min(int(y + reach[k, 1]), rows - 1) + 1):
            for u in range(left, right + 1):
                p = A[k, 0, 0] * (u - x) + A[k, 0, 1] * (v - y)
                q = A[k, 1, 0] * (u - x) + A[k, 1, 1] * (v - y)
                inside = 1 - p * p - q * q
                if inside > 0:
                    weight = np.float32(weights[k] * inside * inside)
                    value = sample_texture(texture, p * radius + offset[k, 0], q * radius + offset[k, 1])
                    total[v, u] += weight * value
                    power[v, u] += weight * weight
                    bright = max(value - _FOAM_FROM, np.float32(0))
                    foam[v, u] += weight * bright * bright


class Water(NamedTuple):
    """The water at one instant.

    Attributes:
        drifting: (h, w) float32 grey levels of what drifts.
        clarity: (h/8, w/8) float32, share of the bed that is seen.
        waves: (n, 5) as from `surface.wind_waves`.
        trains: (n, 6) as from `surface.standing_waves`.
        time_s: since frame 0.
        glint: (4,) centre x, y and radius, px, and strength.
        sparkles: texture of the glint.
    """

    drifting: FloatImage
    clarity: Float32Array
    waves: FloatArray
    trains: FloatArray
    time_s: float
    glint: FloatArray
    sparkles: Texture


@lazy_kernel()
def render_river(texel_H_image: Homography, map_H_image: Homography, brightness: Gray, wet: Gray,
                 water: Water) -> FloatImage:
    """Grey levels (h, w) float32 of ground and water, without particles and noise.

    Args:
        texel_H_image: (3, 3), from pixels to texels.
        map_H_image: (3, 3), from pixels to east and north, m.
        brightness: (h, w) uint8, see `GroundTexture`.
        wet: (h, w) uint8, see `GroundTexture.water`.
        water: its surface.
    """
    image = np.empty_like(water.drifting)
    for v in range(image.shape[0]):
        for u in range(image.shape[1]):
            tx, ty = texel(texel_H_image, u, v)
            share = sample_linear(wet, tx, ty) / np.float32(255)
            seen = sample_linear(water.clarity, tx / COARSE, ty / COARSE)
            land = np.float32(0)
            if share < 1 or seen > 0:
                land = land_level(texel_H_image, brightness, u, v)
            level = (1 - share) * land
            if share > 0:
                east, north = texel(map_H_image, u, v)
                own = _WATER_LEVEL + water.drifting[v, u] + _wave_level(water, east, north) + _glint_level(water, u, v)
                level += share * (own + seen * (land - _WATER_LEVEL))
            image[v, u] = level
    return image


@lazy_kernel(inline="always")
def _wave_level(water: Water, east: float, north: float) -> np.float32:
    level = 0.0
    waves, trains = water.waves, water.trains
    for k in range(len(waves)):
        phase = waves[k, 0] * east + waves[k, 1] * north - waves[k, 2] * water.time_s + waves[k, 3]
        level += waves[k, 4] * np.cos(phase)
    for k in range(len(trains)):
        x, y = east - trains[k, 0], north - trains[k, 1]
        away = (x * x + y * y) / (trains[k, 4] * trains[k, 4])
        if away < 9:
            level += trains[k, 5] * np.exp(-away) * np.cos(trains[k, 2] * x + trains[k, 3] * y)
    return np.float32(level)


@lazy_kernel(inline="always")
def _glint_level(water: Water, u: int, v: int) -> np.float32:
    x, y, radius, strength = water.glint
    if strength == 0:
        return np.float32(0)
    shine = np.exp(-((u - x) ** 2 + (v - y) ** 2) / (radius * radius))
    sparkle = max(sample_texture(water.sparkles, u - x, v - y) - _SPARKLE_FROM, np.float32(0))
    return np.float32(strength * shine * (0.4 + 1.2 * sparkle))


@lazy_kernel()
def shore_distances_m(layout: Layout, shore: Texture, points: FloatArray) -> FloatArray:
    """Distances (N,) to the nearest shore, positive in the water, of points (N, 2) of the renderer's world."""
    distances = np.empty(len(points))
    for k in range(len(points)):
        distances[k] = depth_m(layout, shore, points[k, 0], points[k, 1])
    return distances
