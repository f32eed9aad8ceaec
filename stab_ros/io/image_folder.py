"""Folders of images as streams of frames."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np

from stab_ros.core.errors import InputError, MessageError
from stab_ros.core.types import Frame, Image
from stab_ros.io.capture_times import CaptureTimes
from stab_ros.io.decoded_image import decoded_frame
from stab_ros.io.frame_reader import DEFAULT_FPS, FRAME_ID, Decoded, stamp_ns
from stab_ros.io.image_metadata import ImageMetadata, read_metadata, turned
from stab_ros.io.image_names import image_files, name_remarks
from stab_ros.io.orientation import Orientation
from stab_ros.io.stored_image import StoredImage, stored_images
from stab_ros.io.tiff_pages import DamagedTiffError

_PLAIN = (b"P1", b"P2", b"P3")  # PBM, PGM and PPM whose numbers are text


class ImageFolder:
    """A folder of images of one size in the order of the numbers in their names; TIFF files page by page.

    Raises:
        InputError: two sizes (while reading).
    """

    def __init__(self, folder: Path, fps: float | None) -> None:
        files = image_files(folder)
        found = [stored_images(file) for file in files]
        self._folder = folder
        self._images = [image for images, _ in found for image in images]
        self._said = [*name_remarks(folder, files), *(remark for _, remark in found if remark)]
        self.fps = fps or DEFAULT_FPS
        self.count: int | None = len(self._images)
        self._first: tuple[StoredImage, Frame] | None = None  # that can be decoded
        self._orientation, self._times = Orientation(), CaptureTimes()
        self._metadata(len(self._images) - 1)  # so that the rate is known before all is read

    @property
    def warnings(self) -> list[str]:
        found = (self._orientation.remark, self._times.remark(self.fps))
        return [*self._said, *(f"{self._folder}: {remark}" for remark in found if remark)]

    def frames(self) -> Iterator[tuple[int, Decoded]]:
        for number in range(len(self._images)):
            stamp = stamp_ns(number, self.fps)
            yield stamp, self._frame(number, stamp)

    def close(self) -> None:
        """Nothing stays open between images."""

    def _frame(self, number: int, stamp: int) -> Decoded:
        image, about = self._images[number], self._metadata(number)
        if about.pictures > 1:
            return MessageError(f"{image.file} is an animation of {about.pictures} pictures, each must be a file of "
                                f"its own: ffmpeg -i {image.file.name} frame%04d.png")
        pixels, path = _pixels(image), image.file.parent / image.name
        if pixels is None:
            return MessageError(f"{path} cannot be decoded")
        own = about.orientation if image.orientation is None else image.orientation
        decoded = _decoded(turned(pixels, self._orientation.take(image.name, own)), path, stamp)
        if isinstance(decoded, Frame):
            self._first = self._first or (image, decoded)
            _check_size(*self._first, image, decoded)
        return decoded

    def _metadata(self, number: int) -> ImageMetadata:
        """Of an image's file; pages have none of their own."""
        image = self._images[number]
        about = read_metadata(image.file) if image.page is None else ImageMetadata()
        self._times.add(number, image.name, about.taken)
        return about


def _pixels(image: StoredImage) -> Image | None:
    """The array as stored; None: it cannot be decoded."""
    try:
        data = image.read()
        if data.startswith(_PLAIN):
            data += b"\n"  # after the last number OpenCV needs one more character
        return cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    except (OSError, DamagedTiffError, cv2.error):
        return None


def _decoded(pixels: Image, path: Path, stamp: int) -> Decoded:
    """path: of the image, for messages."""
    try:
        return decoded_frame(pixels, stamp, FRAME_ID)
    except MessageError as error:
        return MessageError(f"{path}: {error}")


def _check_size(first: StoredImage, first_frame: Frame, other: StoredImage, other_frame: Frame) -> None:
    if first_frame.size != other_frame.size:
        raise InputError("{}: {} is {}x{} and {} is {}x{}; all images must have one size".format(
            first.file.parent, first.name, *first_frame.size, other.name, *other_frame.size))
