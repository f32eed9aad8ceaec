"""What lies between the scene and the sensor: contrast, blur, exposure, weather, and the sensor's noise."""

from __future__ import annotations

import cv2
import numpy as np

from lies.draw import Recipe
from stab_ros.core.types import Float32Array, Gray

_STANDARD = 960 * 540  # px, of a picture with as many drops as said below


class Light:
    """Makes of what the scene shows what the sensor delivers."""

    def __init__(self, recipe: Recipe) -> None:
        self._recipe, rng = recipe, np.random.default_rng([recipe.seed, 3])
        self._level = rng.uniform(85, 150)
        self._pace, self._fog = rng.uniform(0.05, 0.5), rng.uniform(0.3, 0.65)
        self._drops = int(rng.uniform(150, 500) * recipe.size[0] * recipe.size[1] / _STANDARD)
        self._slant = rng.uniform(-0.4, 0.4)

    def sensed(self, picture: Float32Array, k: int) -> Gray:
        """Frame k as the sensor delivers it: (h, w) uint8."""
        rng = np.random.default_rng([self._recipe.seed, 4, k])
        light = self._exposed(self._weather(picture, rng), k)
        if self._recipe.blur_px > 0.3:
            light = np.asarray(cv2.GaussianBlur(light, (0, 0), self._recipe.blur_px), np.float32)
        if self._recipe.noise > 0.05:
            light += np.float32(self._recipe.noise) * rng.standard_normal(light.shape, dtype=np.float32)
        return np.asarray(cv2.convertScaleAbs(np.maximum(light, 0)))

    def _exposed(self, picture: Float32Array, k: int) -> Float32Array:
        gain = 1 + self._recipe.exposure * np.sin(self._pace * k)
        scale = gain * self._recipe.contrast
        return picture * np.float32(scale) + np.float32(gain * self._level - 128 * scale)

    def _weather(self, picture: Float32Array, rng: np.random.Generator) -> Float32Array:
        if self._recipe.weather == "fog":
            veil = np.linspace(235, 190, picture.shape[0], dtype=np.float32)[:, None]
            return picture * np.float32(self._fog) + np.float32(1 - self._fog) * veil
        return self._rained(picture, rng) if self._recipe.weather == "rain" else picture

    def _rained(self, picture: Float32Array, rng: np.random.Generator) -> Float32Array:
        streaks, (height, width) = np.zeros(picture.shape, np.uint8), picture.shape
        for x, y, length in rng.uniform((0, -20, 8), (width, height, 30), (self._drops, 3)):
            cv2.line(streaks, (int(x), int(y)), (int(x + self._slant * length), int(y + length)), 60, 1, cv2.LINE_AA)
        return picture + streaks
