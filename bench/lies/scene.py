"""The ground with its river, seen through a homography."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import cv2
import numpy as np

from lies import textures
from lies.draw import Recipe
from stab_ros.core.types import Float32Array, FloatArray, Gray, Homography, Image

Shutter: TypeAlias = Callable[[Image], Image]  # what a shutter makes of a picture that it reads row by row

_FINE, _COARSE = 2.37, 1.61  # texels per px, up to 960 px of width and beyond; no whole numbers: errors average out
_HALVED = np.array([[0.5, 0, -0.25], [0, 0.5, -0.25], [0, 0, 1.0]])  # from the pixels of a picture twice as large
_SWINGS = (2.0, 9.0)  # of the rows of a picture that the shutter reads one by one


class Scene:
    """What a camera sees of a plane: its own pixels are averages over four samples of a texture finer than they."""

    def __init__(self, recipe: Recipe) -> None:
        self._recipe, rng = recipe, np.random.default_rng([recipe.seed, 2])
        self._size = recipe.size
        self._ground = textures.ground(recipe.texture, recipe.variant)
        per_px = _FINE if recipe.size[0] <= 960 else _COARSE
        self._texel_H_world = _texels(self._ground, per_px, recipe.size, rng)
        self._river = None if recipe.water == "none" else River(recipe, rng)
        self._swings, self._phase = rng.uniform(*_SWINGS), rng.uniform(0.1, 0.9)

    def picture(self, world_H_cur: Homography, k: int) -> Float32Array:
        """Frame k without any fault: (h, w) float32, 0 to 255."""
        width, height = self._size
        H = self._texel_H_world @ world_H_cur @ _HALVED
        large = cv2.warpPerspective(self._ground, H, (2 * width, 2 * height),
                                    flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP, borderMode=cv2.BORDER_REFLECT_101)
        land: Float32Array = cv2.resize(self._swung(large, k), self._size, interpolation=cv2.INTER_AREA)
        if self._river is None:
            return land
        return self._river.over(land, world_H_cur, k, lambda seen: self._swung(seen, k))

    def _swung(self, picture: Image, k: int) -> Image:
        """Rows shifted to and fro by vibration; no more than that which no homography takes up."""
        if not self._recipe.jello_px:
            return picture
        rows = np.linspace(-1, 1, picture.shape[0])
        swing = np.sin(np.pi * rows * self._swings + 2 * np.pi * self._phase * k)
        low_order = np.vander(rows, 3)
        swing -= low_order @ np.linalg.lstsq(low_order, swing, rcond=None)[0]
        scale = picture.shape[1] / self._size[0]
        x = np.arange(picture.shape[1]) + scale * self._recipe.jello_px * swing[:, None]
        y = np.broadcast_to(np.arange(picture.shape[0], dtype=np.float32)[:, None], x.shape)
        x = x.astype(np.float32)
        return np.asarray(cv2.remap(picture, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE))


class River:
    """Water between two banks, or beside one."""

    def __init__(self, recipe: Recipe, rng: np.random.Generator) -> None:
        self._recipe = recipe
        angle = rng.uniform(0, 2 * np.pi)
        self._flow = recipe.water_px * np.array([-np.sin(angle), np.cos(angle)])
        self._across = np.array([np.cos(angle), np.sin(angle)])
        self._mask, self._mask_H_world = _mask(recipe, angle, rng)
        self._ripples = [textures.water(int(rng.integers(3))) for _ in range(2)]
        self._texel_H_world = [_texels(ripple, 1.0, recipe.size, rng) for ripple in self._ripples]
        self._level, self._strength = rng.uniform(60, 130), rng.uniform(0.25, 1.0)
        self._glint = rng.uniform(0, 1, 2) * recipe.size

    def over(self, land: Float32Array, world_H_cur: Homography, k: int, shutter: Shutter) -> Float32Array:
        """The picture of the land, where there is no water, and of the water at frame k, seen by the same shutter."""
        alpha = cv2.warpPerspective(self._mask, self._mask_H_world @ world_H_cur, self._recipe.size,
                                    flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP, borderMode=cv2.BORDER_REPLICATE)
        share = shutter(alpha).astype(np.float32) / 255
        return np.asarray(cv2.blendLinear(shutter(self._water(world_H_cur, k)), land, share, 1 - share))

    def _water(self, world_H_cur: Homography, k: int) -> Float32Array:
        main = self._layer(0, world_H_cur, self._flow * k)
        if self._recipe.water == "rigid":
            return _lit(main, self._level, self._strength)
        aslant = 0.5 * self._recipe.water_px * self._across
        other = self._layer(1, world_H_cur, (0.7 * self._flow + aslant) * k)
        waves = cv2.addWeighted(main, 0.7, other, 0.7, -51)
        if self._recipe.water == "evolving":
            return _lit(waves, self._level, self._strength)
        return self._glittering(waves)

    def _glittering(self, waves: Float32Array) -> Float32Array:
        """White where the waves are high, most of all where the sun is mirrored: a place in the picture."""
        yy, xx = np.ogrid[: waves.shape[0], : waves.shape[1]]
        away = ((xx - self._glint[0]) ** 2 + (yy - self._glint[1]) ** 2) / (0.3 * waves.shape[1]) ** 2
        limit = (205 - 35 * np.exp(-away)).astype(np.float32)
        white = np.clip((waves - limit) / 6, 0, 1)
        dark = _lit(waves, self._level * 0.7, self._strength * 0.5)
        return np.asarray(dark + white * (250 - dark), np.float32)

    def _layer(self, which: int, world_H_cur: Homography, moved: FloatArray) -> Float32Array:
        H = self._texel_H_world[which] @ _shift(-moved) @ world_H_cur
        return np.asarray(cv2.warpPerspective(self._ripples[which], H, self._recipe.size,
                                              flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
                                              borderMode=cv2.BORDER_REFLECT_101))


def _lit(texture: Float32Array, level: float, strength: float) -> Float32Array:
    return texture * np.float32(strength) + np.float32(level - 128 * strength)


def _shift(by: FloatArray) -> Homography:
    return np.array([[1, 0, by[0]], [0, 1, by[1]], [0, 0, 1.0]])


def _texels(texture: Float32Array, per_px: float, size: tuple[int, int], rng: np.random.Generator) -> Homography:
    """From the plane, whose unit is a px, to a texture; the picture's middle lies somewhere in its middle."""
    middle = np.array(texture.shape[::-1]) * rng.uniform(0.4, 0.6, 2)
    x, y = middle - per_px * np.array(size) / 2
    return np.array([[per_px, 0, x], [0, per_px, y], [0, 0, 1]])


def _mask(recipe: Recipe, angle: float, rng: np.random.Generator) -> tuple[Gray, Homography]:
    """Where the water is, over three times the picture, and the homography there from the plane."""
    width, height = recipe.size
    x, y = np.arange(3 * width, dtype=np.float32) - 1.5 * width, np.arange(3 * height, dtype=np.float32) - 1.5 * height
    across = x * np.float32(np.cos(angle)) + y[:, None] * np.float32(np.sin(angle))
    along = y[:, None] * np.float32(np.cos(angle)) - x * np.float32(np.sin(angle))
    half = (abs(width * np.cos(angle)) + abs(height * np.sin(angle))) / 2
    across += 0.05 * half * np.sin(along / (0.4 * width) + rng.uniform(0, 6)).astype(np.float32)
    inside = _inside(across, half, recipe, rng)
    mask = np.clip(255 * (inside / 3 + 0.5), 0, 255).astype(np.uint8)
    return mask, _shift(np.array([width, height]))


def _inside(across: Float32Array, half: float, recipe: Recipe, rng: np.random.Generator) -> Float32Array:
    """How far inside the water, px; `across` from the picture's middle, which reaches `half` px to either side."""
    share = recipe.water_share
    if recipe.banks == 1:
        return np.asarray(half * (2 * share - 1) - across)
    return np.asarray(share * half - np.abs(across - rng.uniform(-0.7, 0.7) * (1 - share) * half))
