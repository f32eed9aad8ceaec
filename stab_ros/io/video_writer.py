"""The stabilised frames as a video."""

from __future__ import annotations

from pathlib import Path
from types import TracebackType

import cv2
import numpy as np

from stab_ros.core.errors import WorkError
from stab_ros.core.gray import AS_IT_IS, GreyRange, grey_range, to_gray
from stab_ros.core.text import counted
from stab_ros.core.types import Frame, Image

_TO_BGR = {
    "rgb8": cv2.COLOR_RGB2BGR,
    "bgra8": cv2.COLOR_BGRA2BGR,
    "rgba8": cv2.COLOR_RGBA2BGR,
}


class VideoWriter:
    """An mp4 with one image for every input frame, as large as the first (MPEG-4 drops an odd last column or row).

    An image of another size is scaled to fit in, with black bars.

    Without an image (a lost frame is dropped) the last one is repeated, so that frame n of the video remains
    frame n of the input; before the first image it is black.

    Raises:
        WorkError: the video cannot be written (any method).
    """

    def __init__(self, path: Path, fps: float) -> None:
        self._path = path
        self._fps = fps
        self._writer = cv2.VideoWriter()
        self._shown: Image = np.empty(0, np.uint8)
        self._range = AS_IT_IS
        self._frames = 0

    def write(self, frame: Frame | None, image: Image | None) -> None:
        """frame: of the input, None where it cannot be decoded. image: the same, stabilised (`warped_encoding`)."""
        self._frames += 1
        if frame is not None and not self._writer.isOpened():
            self._open(frame)
        if frame is not None and image is not None:
            self._show(image, frame.warped_encoding)
        if self._writer.isOpened():
            self._writer.write(self._shown)

    def close(self) -> None:
        self._writer.release()

    def check(self) -> None:
        """FFmpeg hides a full disk: the finished file must hold what was written."""
        capture = cv2.VideoCapture(str(self._path))
        found = int(capture.get(cv2.CAP_PROP_FRAME_COUNT)) if capture.isOpened() else 0
        capture.release()
        if found != self._frames:
            raise WorkError(f"{self._path}: only {found} of {counted(self._frames, 'frame')} in the file; "
                            "is the disk full?")

    def __enter__(self) -> VideoWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
        if kind is None:
            self.check()

    def _open(self, frame: Frame) -> None:
        codec = cv2.VideoWriter.fourcc(*"mp4v")
        if not self._writer.open(str(self._path), codec, self._fps, frame.size):
            raise WorkError(f"{self._path}: a video of {frame.size[0]}x{frame.size[1]} cannot be written here")
        self._range = grey_range(frame)
        self._shown = np.zeros((*frame.image.shape[:2], 3), np.uint8)
        for _ in range(self._frames - 1):
            self._writer.write(self._shown)

    def _show(self, image: Image, encoding: str) -> None:
        height, width = self._shown.shape[:2]
        self._shown = _fitted(to_bgr(Frame(image, encoding, stamp_ns=0), self._range), (width, height))


def _fitted(image: Image, size: tuple[int, int]) -> Image:
    """`image` (bgr8), scaled and centred in an image of this width and height."""
    height, width = image.shape[:2]
    if (width, height) == size:
        return image
    scale = min(size[0] / width, size[1] / height)
    inner = (max(1, round(width * scale)), max(1, round(height * scale)))
    left, top = (size[0] - inner[0]) // 2, (size[1] - inner[1]) // 2
    fitted = np.zeros((size[1], size[0], 3), np.uint8)
    interpolation = cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR
    fitted[top : top + inner[1], left : left + inner[0]] = cv2.resize(image, inner, interpolation=interpolation)
    return fitted


def to_bgr(frame: Frame, shown: GreyRange) -> Image:
    """(h, w, 3) uint8. shown: of an image of more than 8 bits."""
    if frame.encoding == "bgr8":
        return frame.image
    if frame.encoding == "bgr16":
        return shown.to_8_bit(frame.image)
    if frame.encoding in _TO_BGR:
        return np.asarray(cv2.cvtColor(frame.image, _TO_BGR[frame.encoding]))
    return np.asarray(cv2.cvtColor(to_gray(frame, shown), cv2.COLOR_GRAY2BGR))
