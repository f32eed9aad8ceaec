"""Frames of a plane whose texture moves with a known velocity, seen by a camera with known homographies."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from scipy.ndimage import gaussian_filter, map_coordinates

from stab_ros.core.geometry import apply
from stab_ros.core.types import FloatArray, Gray
from stab_ros.velocimetry.placed_frame import PlacedFrame

_TEXTURE_SIDE = 512  # px of the periodic texture
Flow = Callable[[FloatArray], FloatArray]  # (N,) places across -> (N,) velocities along x: a parallel flow


def texture(rng: np.random.Generator, smooth_px: float = 1.5) -> FloatArray:
    """A periodic random texture (512, 512) of mean 0 and standard deviation 1; smooth_px: its correlation length."""
    smooth = gaussian_filter(rng.normal(size=(_TEXTURE_SIDE, _TEXTURE_SIDE)), smooth_px, mode="wrap")
    return np.asarray((smooth - smooth.mean()) / smooth.std())


def ripples(rng: np.random.Generator, wave_px: float, spread: float = 0.128) -> FloatArray:
    """A periodic texture (512, 512) of waves along x; spread: relative standard deviation of their number in a length.

    Its correlation with itself a wave on is `exp(-2 (pi spread)^2)`, 0.72.
    """
    k = np.fft.fftfreq(_TEXTURE_SIDE) * wave_px
    spectrum = np.exp(-(((np.abs(k)[None, :] - 1) / spread) ** 2) / 2 - (k[:, None] / 0.32) ** 2 / 2)
    waves = np.fft.ifft2(np.fft.fft2(rng.normal(size=(_TEXTURE_SIDE, _TEXTURE_SIDE))) * spectrum).real
    return np.asarray(waves / waves.std())


@dataclass(frozen=True)
class MovingTexture:
    """What is seen, and how.

    Attributes:
        flow: velocity along x on the plane, units/s, by y.
        size: width and height of the pictures, px.
        gsd: side of a pixel on the plane, units.
        fps: frames/s.
        noise: standard deviation of the noise of the camera, grey levels.
        contrast: standard deviation of the texture, grey levels.
        smooth_px: correlation length of the texture.
        shake_px: standard deviation of the shift of the camera between frames.
        sigma_px: standard deviation of the shift by which the homographies told are wrong.
        renewal_s: time after which the texture is another one; 0: it lasts.
        standing: standard deviation of a pattern that stands still over the water, grey levels.
        flicker: relative change of brightness, standard deviation.
        wave_px: length of the waves of which the texture consists; 0: it does not repeat.
    """

    flow: Flow
    size: tuple[int, int] = (256, 192)
    gsd: float = 0.02
    fps: float = 25.0
    noise: float = 2.0
    contrast: float = 25.0
    smooth_px: float = 1.5
    shake_px: float = 0.0
    sigma_px: float = 0.0
    renewal_s: float = 0.0
    standing: float = 0.0
    flicker: float = 0.0
    seed: int = 0
    wave_px: float = 0.0
    tilt: tuple[float, float] = field(default=(0.0, 0.0))  # h20, h21 of plane_H_image, per px

    def frames(self, count: int) -> list[PlacedFrame]:
        """The first `count` frames, on a plane in metres, y to the north."""
        rng = np.random.default_rng(self.seed)
        textures = [texture(rng, self.smooth_px) for _ in range(3)]
        if self.wave_px:
            textures[0] = ripples(rng, self.wave_px)
        return [self._frame(i, textures, rng) for i in range(count)]

    def _frame(self, index: int, textures: list[FloatArray], rng: np.random.Generator) -> PlacedFrame:
        true = self._plane_H_image(rng.normal(size=2) * self.shake_px)
        x, y = np.meshgrid(np.arange(self.size[0], dtype=float), np.arange(self.size[1], dtype=float))
        places = apply(true, np.stack([x.ravel(), y.ravel()], axis=1))
        gray = 128 + self._seen(places, index / self.fps, textures).reshape(x.shape)
        gray = gray * (1 + self.flicker * rng.normal()) + self.noise * rng.normal(size=x.shape)
        told = true.copy()
        told[:2, 2] += rng.normal(size=2) * self.sigma_px * self.gsd
        covariance = np.zeros((8, 8))
        covariance[2, 2] = covariance[5, 5] = (self.sigma_px * self.gsd) ** 2
        picture: Gray = np.clip(np.round(gray), 0, 255).astype(np.uint8)
        return PlacedFrame(round(index / self.fps * 1e9), picture, told, covariance)

    def _plane_H_image(self, shift_px: FloatArray) -> FloatArray:
        g = self.gsd
        return np.array([[g, 0, g * shift_px[0]], [0, -g, g * (self.size[1] + shift_px[1])], [*self.tilt, 1.0]])

    def _seen(self, places: FloatArray, time_s: float, textures: list[FloatArray]) -> FloatArray:
        moved = places - np.stack([self.flow(places[:, 1]) * time_s, np.zeros(len(places))], axis=1)
        turn = time_s / self.renewal_s if self.renewal_s else 0.0
        water = np.cos(turn) * self._at(textures[0], moved) + np.sin(turn) * self._at(textures[1], moved)
        return np.asarray(self.contrast * water + self.standing * self._at(textures[2], places))

    def _at(self, one: FloatArray, places: FloatArray) -> FloatArray:
        at = np.asarray(places[:, ::-1].T / self.gsd)
        return np.asarray(map_coordinates(one, at, order=3, mode="grid-wrap"))


def uniform(velocity: float) -> Flow:
    """The same velocity everywhere."""
    return lambda y: np.full_like(y, velocity)


def shear(velocity: float, gradient_1_s: float) -> Flow:
    """A velocity that grows with y: `velocity` at y = 0, by `gradient_1_s` per unit."""
    return lambda y: velocity + gradient_1_s * y
