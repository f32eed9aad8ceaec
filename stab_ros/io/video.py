"""Video files as streams of frames."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np

from stab_ros.core.errors import InputError
from stab_ros.core.types import Frame, Image
from stab_ros.io.frame_reader import DEFAULT_FPS, FRAME_ID, MAX_FPS, Decoded, stamp_ns

VIDEO_SUFFIXES = (".mp4", ".m4v", ".mov", ".avi", ".mkv", ".webm", ".mpg", ".mpeg", ".mts", ".m2ts", ".ts", ".wmv",
                  ".flv", ".3gp", ".ogv", ".mjpeg", ".mjpg", ".y4m", ".h264", ".h265")


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
