"""What is fixed to the camera or falls before it: added to the picture before it is encoded."""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np

from lies.draw import Recipe
from stab_ros.core.types import Gray

Fault = Callable[[Gray, int], Gray]  # a frame and its number
_STANDARD = 960 * 540  # px, of a picture with as many specks as said below


def fault(recipe: Recipe) -> Fault:
    """The fault of a recipe, as a function of a frame and its number; many leave the pictures as they are."""
    make = _FAULTS.get(recipe.fault)
    return _nothing if make is None else make(recipe, np.random.default_rng([recipe.seed, 5]))


def _nothing(picture: Gray, _k: int) -> Gray:
    return picture


def _osd(recipe: Recipe, rng: np.random.Generator) -> Fault:
    """Rows of text as a drone's display burns in, with figures that change."""
    rows, per_px = int(rng.integers(1, 8)), recipe.size[0] / 960
    places = [(int(rng.uniform(0.01, 0.3) * recipe.size[0]), int((0.1 + 0.85 * (row + rng.uniform(0, 0.5)) / rows)
              * recipe.size[1])) for row in range(rows)]
    long = int(rng.integers(20, 45))

    def write(picture: Gray, k: int) -> Gray:
        picture = picture.copy()
        for row, place in enumerate(places):
            text = f"ALT {30 + row}.{k // 5 % 10} m  GPS 46.{51234 + 37 * row} 7.{98765 - 91 * row}  BAT 7{row} % REC"
            for shade, beside in ((10, 1), (245, 0)):  # its shadow first
                cv2.putText(picture, text[:long], (place[0] + beside, place[1] + beside), cv2.FONT_HERSHEY_SIMPLEX,
                            max(0.4, 0.75 * per_px), shade, max(1, round(1.5 * per_px)), cv2.LINE_AA)
        return picture

    return write


def _late_overlay(recipe: Recipe, rng: np.random.Generator) -> Fault:
    """The same, from some frame of the second half on."""
    write, first = _osd(recipe, rng), int(rng.integers(recipe.frames // 2, recipe.frames - 5))
    return lambda picture, k: write(picture, k) if k >= first else picture


def _hot_pixels(recipe: Recipe, rng: np.random.Generator) -> Fault:
    width, height = recipe.size
    hot = rng.random((height, width)) < 1 / 500
    level = rng.integers(150, 256, (height, width), dtype=np.uint8)
    return lambda picture, _k: np.where(hot, np.maximum(picture, level), picture)


def _fixed_pattern(recipe: Recipe, rng: np.random.Generator) -> Fault:
    """Two to three levels, of each pixel and of each column, as of a thermal camera."""
    width, height = recipe.size
    pattern = rng.normal(0, 1, (height, width)) + rng.choice([0.0, 0.7]) * rng.normal(0, 1, width)
    pattern *= rng.uniform(2, 3) / pattern.std()
    offset = pattern.astype(np.float32)
    return lambda picture, _k: np.clip(picture + offset + 0.5, 0, 255).astype(np.uint8)


def _dirt(recipe: Recipe, rng: np.random.Generator) -> Fault:
    width, height = recipe.size
    dirt, per_px = np.zeros((height, width), np.float32), width / 960
    for _ in range(int(rng.integers(40, 200))):
        cv2.circle(dirt, (int(rng.uniform(0, width)), int(rng.uniform(0, height))),
                   max(1, round(rng.uniform(3, 9) * per_px)), 1.0, -1)
    kept = 1 - rng.uniform(0.3, 0.7) * cv2.GaussianBlur(dirt, (0, 0), max(0.7, 2 * per_px))
    return lambda picture, _k: (picture * kept + 0.5).astype(np.uint8)


def _bars(recipe: Recipe, rng: np.random.Generator) -> Fault:
    """Black bars above and below, or at the sides."""
    width, height = recipe.size
    n = int(rng.uniform(0.03, 0.18) * height)
    shown = (slice(n, height - n), slice(None)) if rng.random() < 0.7 else (slice(None), slice(n, width - n))

    def cover(picture: Gray, _k: int) -> Gray:
        covered = np.zeros_like(picture)
        covered[shown] = picture[shown]
        return covered

    return cover


def _vignette(recipe: Recipe, rng: np.random.Generator) -> Fault:
    """Darker towards the corners; at worst a black rim."""
    width, height = recipe.size
    yy, xx = np.ogrid[-1 : 1 : height * 1j, -1 : 1 : width * 1j]
    radius = np.hypot(xx, yy) / np.sqrt(2)
    kept = 1 - rng.uniform(0.4, 0.8) * radius**2
    if rng.random() < 0.4:
        kept *= np.clip((rng.uniform(0.72, 0.95) - radius) * 40, 0, 1)
    kept = kept.astype(np.float32)
    return lambda picture, _k: (picture * kept + 0.5).astype(np.uint8)


def _legs(recipe: Recipe, rng: np.random.Generator) -> Fault:
    """The drone's own legs, dark and out of focus, reach into the picture, or its shadow lies there."""
    width, height = recipe.size
    covered, foot = np.zeros((height, width), np.float32), rng.uniform((0.15, 0.1), (0.35, 0.4)) * recipe.size
    if rng.random() < 0.6:
        for side in (0, width):
            cv2.line(covered, (side, height), (int(abs(side - foot[0])), int(height - foot[1])), 1.0, width // 24)
        shade = 0.9
    else:
        (x, y), reach = (rng.uniform(0.3, 0.7, 2) * recipe.size).astype(int).tolist(), width // 20
        for arm in (reach, -reach):
            cv2.line(covered, (x - reach, y - arm), (x + reach, y + arm), 1.0, width // 60)
        shade = 0.5
    kept = 1 - shade * cv2.GaussianBlur(covered, (0, 0), width / 320)
    return lambda picture, _k: (picture * kept + 0.5).astype(np.uint8)


def _flakes(recipe: Recipe, rng: np.random.Generator) -> Fault:
    width, height = recipe.size
    n = int(rng.uniform(200, 800) * width * height / _STANDARD)

    def snow(picture: Gray, _k: int) -> Gray:
        picture = picture.copy()
        for x, y, r in rng.uniform((0, 0, 1), (width, height, 5), (n, 3)):
            cv2.circle(picture, (int(x), int(y)), max(1, round(r * width / 960)), 240, -1, cv2.LINE_AA)
        return picture

    return snow


_FAULTS: dict[str, Callable[[Recipe, np.random.Generator], Fault]] = {
    "osd": _osd, "late_overlay": _late_overlay, "hot_pixels": _hot_pixels, "fixed_pattern": _fixed_pattern,
    "dirt": _dirt, "bars": _bars, "soft_bars": _bars, "vignette": _vignette, "flakes": _flakes, "legs": _legs,
}
