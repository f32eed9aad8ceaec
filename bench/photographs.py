"""Flights over photographs with exact homographies, by a renderer that shares nothing with `stab_ros.synthetic`.

A photograph is sampled more finely than it is and averaged over each pixel, as a sensor does. Then comes
what befalls a picture on its way: blur, fog, noise, rows that swing, compression.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from stab_ros.core.types import FloatArray, Gray, Homography
from stab_ros.synthetic.render import FloatImage

_FPS = 25.0
Spoil = Callable[[FloatImage], FloatImage]


@dataclass(frozen=True)
class PhotoFlight:
    """A camera that sways over a photograph.

    Attributes:
        path: of the photograph.
        size: width and height of the pictures, px.
        frames: their number.
        seed: of path and noise.
        noise: grey levels.
        spoil: what befalls every picture but the first before the noise; None: nothing.
        both: whether the first one is spoilt, too.
        quality: of the JPEG that every picture passes through; None: none.
        video: whether the pictures pass through an MPEG-4 video.
        sway_px: how far it sways.
    """

    path: Path
    size: tuple[int, int] = (960, 540)
    frames: int = 30
    seed: int = 1
    noise: float = 2.0
    spoil: Spoil | None = None
    both: bool = False
    quality: int | None = None
    video: bool = False
    sway_px: float = 12.0

    def ref_H_cur(self, index: int) -> Homography:
        """The truth: from pixels of frame `index` to those of the first."""
        H = np.linalg.inv(self._photo_H_image(0)) @ self._photo_H_image(index)
        return np.asarray(H / H[2, 2])

    def pictures(self) -> Iterator[Gray]:
        """All of them, (h, w) uint8."""
        photo = np.asarray(cv2.imread(str(self.path), cv2.IMREAD_GRAYSCALE), np.uint8)
        shots = (self._picture(photo, index) for index in range(self.frames))
        return through_video(list(shots)) if self.video else shots

    def _picture(self, photo: Gray, index: int) -> Gray:
        (width, height), k = self.size, 1 + int(self._photo_scale()[0, 0])
        fine = np.array([[1 / k, 0, (1 / k - 1) / 2], [0, 1 / k, (1 / k - 1) / 2], [0, 0, 1]])
        flags = cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP
        large = cv2.warpPerspective(photo, self._photo_H_image(index) @ fine, (k * width, k * height), flags=flags,
                                    borderMode=cv2.BORDER_REFLECT)
        level: FloatImage = np.asarray(cv2.resize(large.astype(np.float32), self.size, interpolation=cv2.INTER_AREA))
        if self.spoil is not None and (index or self.both):
            level = self.spoil(level)
        level = level + np.random.default_rng([self.seed, index]).normal(0, self.noise, level.shape).astype(np.float32)
        picture = np.asarray(np.clip(level + 0.5, 0, 255), np.uint8)
        return picture if self.quality is None else jpeg(picture, self.quality)

    def _photo_H_image(self, index: int) -> Homography:
        """Shift, turn, scale and tilt, each two waves of incommensurate periods around the middle of the picture."""
        width, height = self.size
        draw = np.random.default_rng(self.seed)
        period_s, phase = draw.uniform(0.7, 3.0, (6, 2)), draw.uniform(0, 2 * np.pi, (6, 2))
        x, y, turn, scale, tilt_x, tilt_y = np.sin(2 * np.pi * index / _FPS / period_s + phase).sum(axis=1) / 2
        c, s = np.cos(0.01 * turn) * (1 + 0.01 * scale), np.sin(0.01 * turn) * (1 + 0.01 * scale)
        moved = np.array([[c, -s, self.sway_px * x], [s, c, self.sway_px * y],
                          [0.01 * tilt_x / width, 0.01 * tilt_y / width, 1]])
        middle = np.array([[1, 0, (width - 1) / 2], [0, 1, (height - 1) / 2], [0, 0, 1]])
        return np.asarray(self._photo_scale() @ middle @ moved @ np.linalg.inv(middle))

    def _photo_scale(self) -> FloatArray:
        """From the pixels of the steady picture to those of the middle of the photograph."""
        tall, wide = np.asarray(cv2.imread(str(self.path), cv2.IMREAD_REDUCED_GRAYSCALE_8)).shape
        zoom = 0.85 * 8 * min(wide / self.size[0], tall / self.size[1])
        left, top = (8 * wide - zoom * self.size[0]) / 2, (8 * tall - zoom * self.size[1]) / 2
        return np.array([[zoom, 0, left + (zoom - 1) / 2], [0, zoom, top + (zoom - 1) / 2], [0, 0, 1]])


def jpeg(picture: Gray, quality: int) -> Gray:
    """The picture after compression."""
    data = cv2.imencode(".jpg", picture, (cv2.IMWRITE_JPEG_QUALITY, quality))[1]
    return np.asarray(cv2.imdecode(data, cv2.IMREAD_GRAYSCALE), np.uint8)


def through_video(pictures: Sequence[Gray]) -> Iterator[Gray]:
    """The pictures after MPEG-4 at OpenCV's own bit rate."""
    with tempfile.TemporaryDirectory() as folder:
        path, size = str(Path(folder) / "flight.mp4"), pictures[0].shape[::-1]
        writer = cv2.VideoWriter(path, cv2.VideoWriter.fourcc(*"mp4v"), _FPS, size)
        for picture in pictures:
            writer.write(cv2.cvtColor(picture, cv2.COLOR_GRAY2BGR))
        writer.release()
        capture = cv2.VideoCapture(path)
        for _ in pictures:
            done, picture = capture.read()
            if done:
                yield np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY), np.uint8)
        capture.release()


def fogged(level: FloatImage) -> FloatImage:
    """A third of the contrast."""
    return np.asarray(level / 3 + 120)


def softened(level: FloatImage) -> FloatImage:
    """Out of focus by 2 px."""
    return np.asarray(cv2.GaussianBlur(level, (0, 0), 2.0))


def slightly_softened(level: FloatImage) -> FloatImage:
    """As most lenses draw, 0.8 px."""
    return np.asarray(cv2.GaussianBlur(level, (0, 0), 0.8))


def dragged(level: FloatImage) -> FloatImage:
    """Motion blur of 9 px."""
    return np.asarray(cv2.blur(level, (9, 1)))


def swung(level: FloatImage) -> FloatImage:
    """Rows that swing by 0.5 px, five times down the picture, with a phase that differs from picture to picture."""
    height, width = level.shape
    y, x = np.mgrid[:height, :width].astype(np.float32)
    phase = np.float32(float(level.mean()) * 1e3 % (2 * np.pi))
    wave = np.float32(0.5) * np.sin(np.float32(10 * np.pi) * y / height + phase)
    return np.asarray(cv2.remap(level, x + wave, y, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT))
