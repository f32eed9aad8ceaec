"""Video files and folders of images as streams of frames.

Stamps are 1 s + frame/fps: the first frame is not stamped 0, which ROS takes for "no time".
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Protocol

import cv2
import numpy as np

from stab_ros.core.errors import InputError, MessageError
from stab_ros.core.types import Frame, Image

VIDEO_SUFFIXES = (".mp4", ".m4v", ".mov", ".avi", ".mkv", ".webm", ".mpg", ".mpeg", ".mts", ".m2ts", ".ts", ".wmv",
                  ".flv", ".3gp", ".ogv", ".mjpeg", ".mjpg", ".y4m", ".h264", ".h265")
IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".webp", ".pgm", ".ppm", ".pnm", ".jp2")
FRAME_ID = "camera"
DEFAULT_FPS = 25.0
MAX_FPS = 1000.0
FIRST_STAMP_NS = 1_000_000_000
_ENCODING = {(1, "uint8"): "mono8", (1, "uint16"): "mono16", (3, "uint8"): "bgr8", (4, "uint8"): "bgra8"}

# a frame, or why the picture in its place cannot be decoded
Decoded = Frame | MessageError


class Pictures(Protocol):
    """A stream of pictures without messages. count: None where the file does not say."""

    fps: float
    count: int | None
    warnings: list[str]

    def frames(self) -> Iterator[tuple[int, Decoded]]:
        """Stamp in ns and what was decoded."""

    def close(self) -> None:
        """Lets go of the file."""


def stamp_ns(frame: int, fps: float) -> int:
    """The stamp of a frame, counted from 0."""
    return FIRST_STAMP_NS + round(frame * 1e9 / fps)


class VideoFile:
    """A video, decoded by OpenCV to bgr8.

    Raises:
        InputError: the file cannot be decoded.
    """

    def __init__(self, path: Path, fps: float | None) -> None:
        self._path = path
        self._capture = cv2.VideoCapture(str(path))
        if not self._capture.isOpened():
            raise self._undecodable()
        own_fps = self._capture.get(cv2.CAP_PROP_FPS)
        self.fps = fps or (own_fps if 0 < own_fps <= MAX_FPS else DEFAULT_FPS)
        announced = self._capture.get(cv2.CAP_PROP_FRAME_COUNT)
        self.count = int(announced) if math.isfinite(announced) and announced > 0 else None
        self.warnings: list[str] = []

    def frames(self) -> Iterator[tuple[int, Decoded]]:
        number = 0
        while (image := self._read()) is not None:
            stamp = stamp_ns(number, self.fps)
            yield stamp, Frame(image, "bgr8", stamp, FRAME_ID)
            number += 1
        if number == 0:
            raise self._undecodable()
        if self.count is not None and number < self.count:
            self.warnings.append(f"{self._path}: {number} of the {self.count} frames it announces can be decoded")

    def close(self) -> None:
        self._capture.release()

    def _read(self) -> Image | None:
        try:
            done, image = self._capture.read()
        except cv2.error:
            return None
        return np.asarray(image) if done else None

    def _undecodable(self) -> InputError:
        return InputError(f"{self._path}: this video cannot be decoded; it must be a file that FFmpeg can play")


class ImageFolder:
    """A folder of images of one size, in the order of their names; as stored (no EXIF rotation), 8 or 16 bit.

    Raises:
        InputError: two sizes (while reading).
    """

    def __init__(self, folder: Path, fps: float | None) -> None:
        self._files = image_files(folder)
        self.fps = fps or DEFAULT_FPS
        self.count: int | None = len(self._files)
        self.warnings: list[str] = []

    def frames(self) -> Iterator[tuple[int, Decoded]]:
        first: tuple[Path, Frame] | None = None
        for number, file in enumerate(self._files):
            stamp = stamp_ns(number, self.fps)
            frame = _decode(file, stamp)
            if isinstance(frame, Frame):
                first = first or (file, frame)
                _check_size(first, (file, frame))
            yield stamp, frame

    def close(self) -> None:
        """Nothing stays open between images."""


def image_files(folder: Path) -> list[Path]:
    """The images of a folder in the order of their names."""
    return sorted((file for file in folder.iterdir() if file.suffix.lower() in IMAGE_SUFFIXES), key=lambda f: f.name)


def _decode(file: Path, stamp: int) -> Decoded:
    try:
        image = cv2.imdecode(np.fromfile(file, np.uint8), cv2.IMREAD_UNCHANGED)
    except (OSError, cv2.error):
        image = None
    if image is None:
        return MessageError(f"{file} cannot be decoded")
    if image.ndim == 3 and image.dtype == np.uint16:
        image = (image >> 8).astype(np.uint8)
    channels = image.shape[2] if image.ndim == 3 else 1
    encoding = _ENCODING.get((channels, image.dtype.name))
    if encoding is None:
        return MessageError(f"{file} has pixels of type {image.dtype.name}, they must be 8 or 16 bit")
    return Frame(image, encoding, stamp, FRAME_ID)


def _check_size(first: tuple[Path, Frame], other: tuple[Path, Frame]) -> None:
    if first[1].size != other[1].size:
        raise InputError("{}: {} is {}x{} and {} is {}x{}; all images must have one size".format(
            first[0].parent, first[0].name, *first[1].size, other[0].name, *other[1].size))
