"""Textures of the ground and of the water, drawn or photographed: float32, 0 to 255.

OpenCV samples float32 at exact positions, uint8 at multiples of 1/32 texel.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np

from stab_ros.core.types import Float32Array, FloatArray

WIDTH, HEIGHT = 3072, 2048  # texels
_STILLS = Path(__file__).resolve().parents[3] / "shared" / "data" / "stills"


@lru_cache(maxsize=6)
def ground(kind: str, variant: int) -> Float32Array:
    """The texture (HEIGHT, WIDTH), or a photograph of another size; without photographs, crowns stand for them."""
    stills = sorted(_STILLS.glob("*.[jJ][pP][gG]")) if kind == "photo" else []
    if stills:
        return _photograph(stills[variant % len(stills)])
    draw = _DRAWN["crowns" if kind == "photo" else kind]
    return _grey(draw(np.random.default_rng([variant, len(kind), ord(kind[0])])))


@lru_cache(maxsize=4)
def water(variant: int) -> Float32Array:
    """Ripples (HEIGHT / 2, WIDTH / 2), without anything finer than three texels."""
    rng = np.random.default_rng([variant, 99])
    return _grey(_octaves(rng, WIDTH // 2, HEIGHT // 2, (2, 4, 8, 16, 64), 1.1))


def _photograph(path: Path) -> Float32Array:
    picture = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    if picture is None:
        raise ValueError(f"{path} is no picture")
    return np.asarray(picture, np.float32)


def _grey(values: Float32Array, deviation: float = 42.0) -> Float32Array:
    scaled = 128 + (values - values.mean()) * (deviation / values.std())
    return np.asarray(np.clip(scaled, 4, 251), np.float32)


def _noise(rng: np.random.Generator, width: int, height: int) -> Float32Array:
    return rng.standard_normal((height, width), dtype=np.float32)


def _octaves(rng: np.random.Generator, width: int, height: int, texels: tuple[int, ...], growth: float) -> Float32Array:
    """Smooth noise of several sizes, in texels; each size is `growth` times as strong as the one before."""
    total = np.zeros((height, width), np.float32)
    for k, texel in enumerate(texels):
        coarse = _noise(rng, -(-width // texel), -(-height // texel))
        total += growth**k * cv2.resize(coarse, (width, height), interpolation=cv2.INTER_CUBIC)
    return total


def _gravel(rng: np.random.Generator) -> Float32Array:
    """Stones of a few px and nothing larger: what does not survive shrinking."""
    fine = cv2.GaussianBlur(_noise(rng, WIDTH, HEIGHT), (0, 0), rng.uniform(1.2, 3))
    stones = np.tanh(2 * fine / fine.std())
    return np.asarray(stones + 0.25 * _octaves(rng, WIDTH, HEIGHT, (64, 256), 1.0), np.float32)


def _grass(rng: np.random.Generator) -> Float32Array:
    blades = cv2.GaussianBlur(_noise(rng, WIDTH, HEIGHT), (0, 0), 0.8, sigmaY=rng.uniform(1.5, 3))
    return np.asarray(blades / blades.std() + 0.5 * _octaves(rng, WIDTH, HEIGHT, (8, 32, 128, 512), 1.1), np.float32)


def _sand(rng: np.random.Generator) -> Float32Array:
    """Smooth, with a few stones."""
    sand = _octaves(rng, WIDTH, HEIGHT, (4, 16, 64, 256), 1.6)
    stones = cv2.GaussianBlur(_noise(rng, WIDTH, HEIGHT), (0, 0), 2.5) > 0.42
    return np.asarray(sand + 4 * sand.std() * stones, np.float32)


def _crowns(rng: np.random.Generator) -> Float32Array:
    """Crowns of trees, the highest on top, lit from one side."""
    heights = np.zeros((HEIGHT, WIDTH), np.float32)
    for x, y, r, top in zip(rng.integers(0, WIDTH, 5000), rng.integers(0, HEIGHT, 5000), rng.integers(10, 46, 5000),
                            rng.uniform(0, 30, 5000), strict=True):
        _raise_dome(heights, int(x), int(y), int(r), float(top))
    leaves = 2.5 * _octaves(rng, WIDTH, HEIGHT, (2, 4, 8), 1.2)
    slope = cv2.Sobel(heights + leaves, cv2.CV_32F, 1, 0) + cv2.Sobel(heights + leaves, cv2.CV_32F, 0, 1)
    return np.asarray(np.tanh(slope / 18) + heights / 60, np.float32)


def _raise_dome(heights: Float32Array, x: int, y: int, r: int, top: float) -> None:
    part = heights[max(0, y - r) : y + r, max(0, x - r) : x + r]
    yy, xx = np.ogrid[max(0, y - r) - y : max(0, y - r) - y + part.shape[0],
                      max(0, x - r) - x : max(0, x - r) - x + part.shape[1]]
    square = (r * r - xx * xx - yy * yy).astype(np.float32)
    np.maximum(part, np.where(square > 0, np.sqrt(np.abs(square)) + top, 0), out=part)


def _fields(rng: np.random.Generator) -> Float32Array:
    """Fields with furrows, roads and hedges."""
    seeds = np.full((HEIGHT // 2, WIDTH // 2), 255, np.uint8)
    seeds[rng.integers(0, HEIGHT // 2, 30), rng.integers(0, WIDTH // 2, 30)] = 0
    _, labels = cv2.distanceTransformWithLabels(seeds, cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL)
    labels = cv2.resize(labels, (WIDTH, HEIGHT), interpolation=cv2.INTER_NEAREST)
    yy, xx = np.mgrid[:HEIGHT, :WIDTH].astype(np.float32)
    angle, period, level = (rng.uniform(low, high, 64).astype(np.float32)[labels]
                            for low, high in ((0, np.pi), (7, 20), (-1.3, 1.3)))
    furrows = 0.3 * np.sin(2 * np.pi * (xx * np.cos(angle) + yy * np.sin(angle)) / period)
    picture = level + furrows + 0.25 * _octaves(rng, WIDTH, HEIGHT, (3, 12, 48), 1.1)
    return _with_roads(rng, np.asarray(picture, np.float32))


def _with_roads(rng: np.random.Generator, picture: Float32Array) -> Float32Array:
    for _ in range(9):
        points = np.stack([np.linspace(-50, WIDTH + 50, 7), HEIGHT * (rng.uniform(-0.2, 1.2) + rng.normal(0, 0.05, 7)
                           + np.linspace(0, rng.uniform(-0.8, 0.8), 7))], axis=1)
        shade, thickness = float(rng.choice([1.8, -1.8])), int(rng.integers(4, 20))
        cv2.polylines(picture, [points.astype(np.int32)], False, shade, thickness, cv2.LINE_8)
    return picture


def _city(rng: np.random.Generator) -> Float32Array:
    """Rows of houses with shadows, streets and cars."""
    picture = np.full((HEIGHT, WIDTH), -0.4, np.float32)
    turn = rng.uniform(-0.5, 0.5)
    axis = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    for _ in range(1500):  # first, so that houses stand on them
        _box(picture, axis, rng.uniform((0, 0), (WIDTH, HEIGHT)), rng.uniform((4, 9), (6, 14)), float(rng.normal(0, 2)))
    for column in range(-60, 90):
        for row in range(-60, 60):
            place = np.array([column * 62.0, row * 58.0]) + rng.uniform(-9, 9, 2)
            if column % 4 and row % 5:
                _house(rng, picture, axis, place @ axis)
    return picture + 0.22 * _octaves(rng, WIDTH, HEIGHT, (2, 6, 40), 1.2)


def _house(rng: np.random.Generator, picture: Float32Array, axis: FloatArray, place: FloatArray) -> None:
    if not (-80 < place[0] < WIDTH + 80 and -80 < place[1] < HEIGHT + 80):
        return
    half, level = rng.uniform((11, 11), (26, 24)), float(rng.normal(0.6, 0.9))
    _box(picture, axis, place + rng.uniform(6, 12), half, -1.6)  # its shadow
    _box(picture, axis, place, half, level)
    _box(picture, axis, place + axis[0] * half[0] / 2, half * (0.5, 1), level - 0.5)  # the other side of the roof


def _box(picture: Float32Array, axis: FloatArray, centre: FloatArray, half: FloatArray, level: float) -> None:
    corners = centre + (np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) * half) @ axis
    cv2.fillConvexPoly(picture, corners.round().astype(np.int32), level)


_DRAWN: dict[str, Callable[[np.random.Generator], Float32Array]] = {
    "gravel": _gravel, "grass": _grass, "sand": _sand, "crowns": _crowns, "fields": _fields, "city": _city,
}
