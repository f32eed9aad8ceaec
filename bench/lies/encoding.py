"""What encoding does to the pictures: JPEG, MPEG-4, and a video codec of blocks at a low bit rate."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import cv2
import numpy as np

from lies.draw import Recipe
from lies.motion import RATE_HZ
from stab_ros.core.types import Float32Array, FloatArray, Gray

_BLOCK = 8  # px
_KEY_EVERY = 50  # frames
_SKIP_BIAS = 1.5  # levels by which a moved block must be better than the one that stays


def encoded(recipe: Recipe, pictures: Sequence[Gray], world_H_cur: FloatArray) -> list[Gray]:
    """The pictures after encoding and decoding; `world_H_cur` (n, 3, 3) is where the blocks may have moved."""
    if recipe.encoding == "jpeg":
        return [_jpeg(picture, recipe.quality) for picture in pictures]
    if recipe.encoding == "mpeg4":
        return _mpeg4(pictures)
    return list(_blocks(pictures, world_H_cur, recipe.step)) if recipe.encoding == "blocks" else list(pictures)


def _jpeg(picture: Gray, quality: int) -> Gray:
    _, data = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, quality])
    return np.asarray(cv2.imdecode(data, cv2.IMREAD_GRAYSCALE), np.uint8)


def _mpeg4(pictures: Sequence[Gray]) -> list[Gray]:
    with TemporaryDirectory() as folder:
        path = str(Path(folder) / "flight.mp4")
        writer = cv2.VideoWriter(path, cv2.VideoWriter.fourcc(*"mp4v"), RATE_HZ, pictures[0].shape[::-1])
        for picture in pictures:
            writer.write(cv2.cvtColor(picture, cv2.COLOR_GRAY2BGR))
        writer.release()
        return list(_read(path, len(pictures)))


def _read(path: str, frames: int) -> Iterator[Gray]:
    capture = cv2.VideoCapture(path)
    for _ in range(frames):
        there, picture = capture.read()
        if not there:
            raise OSError("this OpenCV writes a video that it cannot read")
        yield np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY), np.uint8)
    capture.release()


def _blocks(pictures: Sequence[Gray], world_H_cur: FloatArray, step: int) -> Iterator[Gray]:
    """Blocks predicted from where they were in the frame before, and what is left of the difference after rounding."""
    before: Gray | None = None
    for k, picture in enumerate(pictures):
        guess = np.full_like(picture, 128) if before is None or k % _KEY_EVERY == 0 else _predicted(
            picture, before, np.linalg.inv(world_H_cur[k - 1]) @ world_H_cur[k])
        before = _corrected(picture, guess, step)
        yield before


def _predicted(picture: Gray, before: Gray, before_H_cur: FloatArray) -> Gray:
    """Each block as it was, or from where the camera's motion had it, by quarters of a pixel."""
    height, width = picture.shape
    y, x = np.mgrid[: -(-height // _BLOCK), : -(-width // _BLOCK)] * _BLOCK + (_BLOCK - 1) / 2
    there = np.stack([x, y, np.ones_like(x)], -1) @ before_H_cur.T
    moved = np.round(4 * (there[..., :2] / there[..., 2:] - np.stack([x, y], -1))) / 4
    full = np.kron(moved.astype(np.float32), np.ones((_BLOCK, _BLOCK, 1), np.float32))[:height, :width]
    yy, xx = np.mgrid[:height, :width].astype(np.float32)
    shifted = cv2.remap(before, xx + full[..., 0], yy + full[..., 1], cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    better = _cost(picture, shifted) + _SKIP_BIAS < _cost(picture, before)
    mask = np.kron(better.astype(np.uint8), np.ones((_BLOCK, _BLOCK), np.uint8))[:height, :width]
    return np.asarray(np.where(mask > 0, shifted, before), np.uint8)


def _cost(picture: Gray, guess: Gray) -> Float32Array:
    size = (-(-picture.shape[1] // _BLOCK), -(-picture.shape[0] // _BLOCK))
    return np.asarray(cv2.resize(cv2.absdiff(picture, guess).astype(np.float32), size, interpolation=cv2.INTER_AREA))


def _corrected(picture: Gray, guess: Gray, step: int) -> Gray:
    """The guess and the rounded cosine transform of the difference; small coefficients are dropped."""
    height, width = picture.shape
    rest = np.zeros((-(-height // _BLOCK) * _BLOCK, -(-width // _BLOCK) * _BLOCK), np.float32)
    rest[:height, :width] = picture.astype(np.float32) - guess
    tiles = rest.reshape(len(rest) // _BLOCK, _BLOCK, -1, _BLOCK).swapaxes(1, 2)
    scaled = _COSINE @ tiles @ _COSINE.T / step
    kept = np.sign(scaled) * np.floor(np.abs(scaled) + np.float32(0.33)) * step
    back = (_COSINE.T @ kept @ _COSINE).swapaxes(1, 2).reshape(rest.shape)[:height, :width]
    return np.asarray(np.clip(np.round(guess + back), 0, 255), np.uint8)


def _cosine_transform() -> Float32Array:
    n = np.arange(_BLOCK)
    basis = np.cos(np.pi * (2 * n + 1) * n[:, None] / (2 * _BLOCK)) * np.sqrt(2 / _BLOCK)
    basis[0] /= np.sqrt(2)
    return np.asarray(basis, np.float32)


_COSINE = _cosine_transform()
