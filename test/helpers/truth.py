"""Pictures with known homographies, made by nothing of the engine: a random texture, sampled exactly."""

from __future__ import annotations

from functools import cache, lru_cache

import cv2
import numpy as np

from stab_ros.core.geometry import rms_distance
from stab_ros.core.kernels import lazy_kernel
from stab_ros.core.types import FloatArray, Frame, Gray, Homography, LostReason, State, Track

SIZE = (400, 300)
MARGIN_PX = 80
IDENTITY = np.eye(3)
_FINER = 4  # texels to a pixel
_SECOND_NS = 1_000_000_000
_INTERVAL_NS = 40_000_000


@cache
def texture(size: tuple[int, int] = SIZE, seed: int = 1) -> FloatArray:
    """Grey levels of a surface like a photographed ground: amplitude 1/f over all scales, four texels to a pixel."""
    rows, columns = (_FINER * (n + 2 * MARGIN_PX) for n in size[::-1])
    f = np.hypot(*np.meshgrid(np.fft.fftfreq(rows), np.fft.rfftfreq(columns), indexing="ij"))
    amplitude = (f + 1 / (64 * _FINER)) ** -1.1 * np.exp(-((f * _FINER / 0.45) ** 4))  # nothing beyond Nyquist
    noise = np.fft.rfft2(np.random.default_rng(seed).standard_normal((rows, columns)))
    levels = np.fft.irfft2(noise * amplitude, s=(rows, columns))
    return np.asarray(128 + 35 * (levels - levels.mean()) / levels.std(), np.float32)


def picture(ref_H_cur: Homography = IDENTITY, size: tuple[int, int] = SIZE, seed: int = 1, noise: float = 1.0,
            gain: float = 1.0, offset: float = 0.0) -> Gray:
    """What the camera sees of the texture when its pixels lie at `ref_H_cur` p: sampled at 2x and area-averaged."""
    return _picture(ref_H_cur.tobytes(), size, seed, noise, gain, offset).copy()


@lru_cache(256)  # many tests ask for the same
def _picture(place: bytes, size: tuple[int, int], seed: int, noise: float, gain: float, offset: float) -> Gray:
    ref_H_cur = np.frombuffer(place).reshape(3, 3)
    x, y = np.meshgrid(np.arange(size[0], dtype=float), np.arange(size[1], dtype=float))
    total = np.zeros(size[::-1])
    for dx, dy in ((-0.25, -0.25), (0.25, -0.25), (-0.25, 0.25), (0.25, 0.25)):
        total += sampled(ref_H_cur, x + dx, y + dy, size, seed)
    grain = np.random.default_rng([seed, *ref_H_cur.tobytes()]).normal(0, noise, x.shape)
    return np.asarray(np.clip(np.round(gain * total / 4 + offset + grain), 0, 255), np.uint8)


def sampled(ref_H_cur: Homography, x: FloatArray, y: FloatArray, size: tuple[int, int], seed: int) -> FloatArray:
    """The texture where pixels (x, y) look, bilinear in double precision (cv2 rounds its maps to 1/32)."""
    pixels = np.column_stack([np.ravel(x), np.ravel(y)])
    return np.asarray(_sampled(texture(size, seed), np.ascontiguousarray(ref_H_cur), pixels)).reshape(np.shape(x))


@lazy_kernel()
def _sampled(surface: FloatArray, H: Homography, pixels: FloatArray) -> FloatArray:
    rows, columns = surface.shape
    found = np.empty(len(pixels))
    for k in range(len(pixels)):
        x, y = pixels[k]
        w = H[2, 0] * x + H[2, 1] * y + H[2, 2]
        column = ((H[0, 0] * x + H[0, 1] * y + H[0, 2]) / w + MARGIN_PX) * _FINER
        row = ((H[1, 0] * x + H[1, 1] * y + H[1, 2]) / w + MARGIN_PX) * _FINER
        column, row = min(max(column, 0.0), columns - 1.001), min(max(row, 0.0), rows - 1.001)
        j, i = int(column), int(row)
        fx, fy = column - j, row - i
        top = surface[i, j] * (1 - fx) + surface[i, j + 1] * fx
        bottom = surface[i + 1, j] * (1 - fx) + surface[i + 1, j + 1] * fx
        found[k] = top * (1 - fy) + bottom * fy
    return found


def frame(image: Gray, index: int = 0, encoding: str = "mono8") -> Frame:
    """The `index`-th frame of a stream at 25 frames a second."""
    return Frame(image, encoding, _SECOND_NS + index * _INTERVAL_NS, "camera")


def unmoved(one: Frame, index: int, lost: bool = False) -> Track:
    """The answer to a frame that lies where the reference does, or is lost."""
    if lost:
        return Track(State.LOST, index, one.stamp_ns, 0, 0, lost_reason=LostReason.NO_FEATURES)
    return Track(State.TRACKED, index, one.stamp_ns, 0, 0, ref_H_cur=IDENTITY)


def letterboxed(count: int) -> list[Gray]:
    """Pictures of a camera that sways by 25 px, between two bars with text: a fifth of the picture."""
    pictures = [picture(translation(25 * np.sin(k / 6), 12 * np.sin(k / 4))) for k in range(count)]
    for one in pictures:
        one[:40] = one[-40:] = 20
        for y, text in ((28, "ALT 32.5 M SPD 4.1"), (288, "REC 00:12 N 46.2 E")):
            cv2.putText(one, text, (8, y), cv2.FONT_HERSHEY_SIMPLEX, 0.8, 255, 2)
    return pictures


def random_noise(index: int = 0, size: tuple[int, int] = SIZE) -> Gray:
    """A picture in which nothing of any other is to be found."""
    return np.random.default_rng([77, index]).integers(0, 256, size[::-1], dtype=np.uint8)


def flat(level: int = 90, noise: float = 2.0, size: tuple[int, int] = SIZE) -> Gray:
    """A picture of nothing, with the camera's noise."""
    grain = np.random.default_rng([78, level]).normal(level, noise, size[::-1])
    return np.asarray(np.clip(np.round(grain), 0, 255), np.uint8)


def translation(x_px: float, y_px: float) -> Homography:
    return np.array([[1, 0, x_px], [0, 1, y_px], [0, 0, 1.0]])


def similarity(degrees: float, scale: float, x_px: float = 0.0, y_px: float = 0.0,
               size: tuple[int, int] = SIZE) -> Homography:
    """Rotation and scale about the middle of the picture, then a shift."""
    c, s = scale * np.cos(np.radians(degrees)), scale * np.sin(np.radians(degrees))
    cx, cy = (size[0] - 1) / 2, (size[1] - 1) / 2
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])
    return np.asarray(translation(cx + x_px, cy + y_px) @ turn @ translation(-cx, -cy))


def projective() -> Homography:
    """What a drone does that sways and tilts: everything at once, corners off by about 10 px."""
    H = similarity(1.2, 1.01, 3.3, -2.6) @ np.array([[1.004, 0.003, 0.2], [-0.002, 0.997, 0.4], [2e-5, -1.5e-5, 1]])
    return np.asarray(H / H[2, 2])


def error_px(track: Track, ref_H_cur: Homography, size: tuple[int, int] = SIZE) -> float:
    """How far a track lies from the truth, px: RMS over the 9x9 grid; a lost frame fails the test."""
    assert track.ref_H_cur is not None, f"frame {track.index} was lost"
    return rms_distance(track.ref_H_cur, ref_H_cur, size)
