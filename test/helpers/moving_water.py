"""Pictures of a plane whose texture moves by a known flow, seen by a camera with a known homography."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from scipy import ndimage

from stab_ros.core.geometry import apply
from stab_ros.core.types import FloatArray, Gray, Homography, IdArray
from stab_ros.imaging.camera import Camera
from stab_ros.velocimetry.placed_frame import PlacedFrame

SIZE = (240, 180)
FPS = 25.0
_TEXELS = 1024
_FINER = 2  # texels to a pixel at unit scale
_SECOND_NS = 1_000_000_000
Flow = Callable[[FloatArray, float], FloatArray]  # places (N, 2) after so many seconds, which may be negative


def uniform(vx: float, vy: float) -> Flow:
    """All water moves alike, px/s."""
    return lambda places, t: places + t * np.array([vx, vy])


def parabolic(speed: float, middle: float, half_width: float, banks: bool = True) -> Flow:
    """Flow along x, `speed` in the middle, 0 from the banks on (all in units of the plane)."""
    def moved(places: FloatArray, t: float) -> FloatArray:
        u = speed * (1 - ((places[:, 1] - middle) / half_width) ** 2)
        u = np.maximum(u, 0) if banks else u
        return np.stack([places[:, 0] + u * t, places[:, 1]], axis=1)
    return moved


def eddy(turn_s: float, centre: tuple[float, float]) -> Flow:
    """Solid rotation by `turn_s` rad/s about a centre."""
    def moved(places: FloatArray, t: float) -> FloatArray:
        c, s = np.cos(turn_s * t), np.sin(turn_s * t)
        return np.asarray((places - centre) @ np.array([[c, -s], [s, c]]).T + centre)
    return moved


@dataclass(frozen=True)
class Water:
    """A river seen from a drone.

    flow: of the water. sharpness_px: shortest wavelength of its texture. noise: grey levels. decay_s: time after which
    the texture has become another; 0: never. camera_at: plane_H_image at a time. scale: units of the plane per pixel.
    """

    flow: Flow
    sharpness_px: float = 4.0
    noise: float = 2.0
    contrast: float = 25.0
    decay_s: float = 0.0
    seed: int = 0
    size: tuple[int, int] = SIZE
    camera_at: Callable[[float], Homography] = lambda _t: np.eye(3)
    scale: float = 1.0
    camera: Camera | None = None
    textures: tuple[FloatArray, FloatArray] = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "textures", tuple(_coefficients(self.sharpness_px, self.seed, k) for k in (0, 1)))

    def gray(self, t: float) -> Gray:
        """(h, w) uint8 at a time, s: sampled at 2x2 points a pixel and averaged."""
        width, height = self.size
        x, y = (a.ravel() for a in np.meshgrid(np.arange(width), np.arange(height)))
        total = np.zeros(width * height)
        for dx, dy in ((-0.25, -0.25), (0.25, -0.25), (-0.25, 0.25), (0.25, 0.25)):
            total += self._levels(np.stack([x + dx, y + dy], axis=1), t) / 4
        grain = np.random.default_rng([self.seed, round(t * 1e6)]).normal(0, self.noise, total.shape)
        return np.clip(np.round(total + grain), 0, 255).astype(np.uint8).reshape(height, width)

    def _levels(self, pixels: FloatArray, t: float) -> FloatArray:
        if self.camera is not None:
            pixels = self.camera.rays(pixels) @ self.camera.K[:2, :2].T + self.camera.K[:2, 2]
        places = self.flow(apply(self.camera_at(t), pixels), -t) / self.scale
        at = places.T[::-1] * _FINER
        one, two = (ndimage.map_coordinates(c, at, order=3, mode="grid-wrap", prefilter=False) for c in self.textures)
        angle = t / self.decay_s if self.decay_s else 0.0
        return np.asarray(125 + self.contrast * (np.cos(angle) * one + np.sin(angle) * two))

    def frame(self, t: float, covariance: FloatArray | None = None, shared: FloatArray | None = None,
              error: FloatArray | None = None) -> PlacedFrame:
        """The placed frame at a time; error: (8,) of h00 .. h21, which the frame's homography has."""
        H = self.camera_at(t).copy()
        if error is not None:
            H.ravel()[:8] += error
        return PlacedFrame(_SECOND_NS + round(t * _SECOND_NS), self.gray(t), H,
                           np.zeros((8, 8)) if covariance is None else covariance,
                           np.zeros((8, 0)) if shared is None else shared, self.camera)

    def truth(self, start: FloatArray, start_ns: IdArray, end_ns: IdArray) -> FloatArray:
        """True velocities (N, 2) of what was at `start` (N, 2) from `start_ns` to `end_ns`."""
        ends = np.array([self.flow(self.flow(p[None], -(a - _SECOND_NS) * 1e-9), (b - _SECOND_NS) * 1e-9)[0]
                         for p, a, b in zip(start, start_ns, end_ns, strict=True)]).reshape(-1, 2)
        return (ends - start) / ((end_ns - start_ns) * 1e-9)[:, None]


def _coefficients(sharpness_px: float, seed: int, which: int) -> FloatArray:
    """Spline coefficients of a random texture: 1/f amplitudes, nothing below a wavelength; standard deviation 1."""
    f = _FINER * np.hypot(*np.meshgrid(np.fft.fftfreq(_TEXELS), np.fft.rfftfreq(_TEXELS), indexing="ij"))
    amplitude = (f + 1 / 60) ** -1.0 * np.exp(-((f * sharpness_px) ** 4))
    noise = np.fft.rfft2(np.random.default_rng([seed, which]).standard_normal((_TEXELS, _TEXELS)))
    levels = np.fft.irfft2(noise * amplitude, s=(_TEXELS, _TEXELS))
    return np.asarray(ndimage.spline_filter((levels - levels.mean()) / levels.std(), order=3, mode="grid-wrap"))


def moving_camera(sway_px: float = 12.0, turn_rad: float = 0.01, tilt: float = 2e-5,
                  scale: float = 1.0, size: tuple[int, int] = SIZE) -> Callable[[float], Homography]:
    """A drone that sways, turns and tilts."""
    def at(t: float) -> Homography:
        a, cx, cy = turn_rad * np.sin(1.7 * t), size[0] / 2, size[1] / 2
        c, s = np.cos(a), np.sin(a)
        turn = np.array([[c, -s, cx - c * cx + s * cy], [s, c, cy - s * cx - c * cy], [0, 0, 1]])
        sway = np.array([[1, 0, sway_px * np.sin(2.3 * t)], [0, 1, sway_px * np.sin(1.9 * t + 1)], [0, 0, 1.0]])
        tilted = np.array([[1, 0, 0], [0, 1, 0], [tilt * np.sin(2 * t), tilt * np.cos(1.3 * t), 1]])
        H = np.diag([scale, scale, 1.0]) @ sway @ turn @ tilted
        return np.asarray(H / H[2, 2])
    return at
