"""What an image file holds besides its pixels: EXIF orientation and capture time, and whether it is animated."""

from __future__ import annotations

import struct
import warnings
from dataclasses import dataclass
from datetime import datetime, timezone
from pathlib import Path

import cv2
import numpy as np
from PIL import Image as Pillow

from stab_ros.core.types import Image

UPRIGHT = 1
TURNS = {
    2: "mirrored left to right", 3: "turned by 180 degrees", 4: "mirrored top to bottom",
    5: "mirrored along the diagonal", 6: "turned by 90 degrees clockwise", 7: "mirrored along the other diagonal",
    8: "turned by 90 degrees counterclockwise",
}  # by EXIF orientation, from the pixels as stored to what a viewer shows
_ORIENTATION, _EXIF, _TAKEN, _SUBSECONDS = 0x0112, 0x8769, 0x9003, 0x9291
_ANIMATED = ("PNG", "WEBP")
# what Pillow raises on damaged files
_DAMAGE = (OSError, SyntaxError, ValueError, LookupError, TypeError, AttributeError, struct.error, OverflowError,
           EOFError, MemoryError, RuntimeError, ZeroDivisionError, AssertionError, Pillow.DecompressionBombError)


@dataclass(frozen=True)
class CaptureTime:
    """time_ns: in the camera's clock. resolution_ns: of that clock, as the file gives it."""

    time_ns: int
    resolution_ns: int


@dataclass(frozen=True)
class ImageMetadata:
    """orientation: of EXIF, 1 to 8. pictures: of an animation, else 1."""

    orientation: int = UPRIGHT
    taken: CaptureTime | None = None
    pictures: int = 1


def read_metadata(file: Path) -> ImageMetadata:
    """The metadata of an image file; what is missing or damaged is as if it were not there."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # Pillow warns of damaged EXIF
            with Pillow.open(file) as image:
                return _metadata_of(image)
    except _DAMAGE:
        return ImageMetadata()


def _metadata_of(image: Pillow.Image) -> ImageMetadata:
    pictures = getattr(image, "n_frames", 1) if image.format in _ANIMATED else 1
    if image.format == "PNG" and "exif" not in image.info:  # for which Pillow would decode all pixels
        return ImageMetadata(pictures=pictures)
    exif = image.getexif()
    known = exif.get(_ORIENTATION) in TURNS
    return ImageMetadata(exif[_ORIENTATION] if known else UPRIGHT, _taken(exif.get_ifd(_EXIF)), pictures)


def turned(image: Image, orientation: int) -> Image:
    """The image, (h, w) or (h, w, channels), as a viewer shows it that follows its EXIF orientation."""
    if orientation in (5, 6, 7, 8):
        image = cv2.transpose(image)
    if orientation in (2, 3, 6, 7):
        image = cv2.flip(image, 1)
    if orientation in (3, 4, 7, 8):
        image = cv2.flip(image, 0)
    return np.asarray(image)


def _taken(exif: dict[int, object]) -> CaptureTime | None:
    text, fraction = exif.get(_TAKEN), exif.get(_SUBSECONDS)
    if not isinstance(text, str):
        return None
    digits = fraction.strip(" \0") if isinstance(fraction, str) else ""
    digits = digits[:9] if digits.isdecimal() else ""
    try:
        seconds = datetime.strptime(text.strip(" \0"), "%Y:%m:%d %H:%M:%S").replace(tzinfo=timezone.utc).timestamp()
    except ValueError:
        return None
    return CaptureTime(int(seconds) * 10**9 + int(digits.ljust(9, "0")), 10 ** (9 - len(digits)))
