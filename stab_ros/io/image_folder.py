"""Folders of images as streams of frames."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np

from stab_ros.core.errors import InputError, MessageError
from stab_ros.core.types import Frame
from stab_ros.io.frame_reader import DEFAULT_FPS, FRAME_ID, Decoded, stamp_ns

IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".webp", ".pgm", ".ppm", ".pnm", ".jp2")
_ENCODING = {(1, "uint8"): "mono8", (1, "uint16"): "mono16", (3, "uint8"): "bgr8", (4, "uint8"): "bgra8"}


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
