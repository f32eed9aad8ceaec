"""Before and after: a video side by side, and an image that shows the residual motion of the ground."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np

from stab_ros.core.errors import WorkError
from stab_ros.core.types import FloatArray, Frame, Image
from stab_ros.demo.replay import STABILIZED
from stab_ros.io.bag import open_bag
from stab_ros.io.cdr import IMAGE
from stab_ros.io.image_message import read_image
from stab_ros.io.source import open_source
from stab_ros.io.video_writer import VideoWriter

_MEAN = np.s_[0:300, 20:500]  # bank, control point and water
_SLICE_X, _SLICE_ROWS = 89, np.s_[0:130]  # a line across the bank, through a control point
_PANEL = (480, 300)  # width and height of each of the four parts
_GAP_PX, _TITLE_PX = 6, 28


def show(recording: Path, stabilized: Path, folder: Path) -> tuple[Path, Path]:
    """Writes before_after.mp4 and before_after.png.

    Raises:
        WorkError: they cannot be written, or the bag holds no image.
    """
    video, picture = folder / "before_after.mp4", folder / "before_after.png"
    before, after = _Stack(), _Stack()
    with open_source(recording) as source:
        fps = source.rate_hz()
    with VideoWriter(video, fps) as writer:
        for raw, steady in _pairs(recording, stabilized):
            before.add(raw.image)
            after.add(steady.image)
            both = np.hstack([_titled(raw.image, "as recorded"), _titled(steady.image, "stabilised")])
            writer.write(Frame(both, "bgr8", raw.stamp_ns), both)
    if not after.count:
        raise WorkError(f"{stabilized}: holds no picture of {STABILIZED}, so there is nothing to show")
    if not cv2.imwrite(str(picture), _four_parts(before, after)):
        raise WorkError(f"{picture}: cannot be written")
    return video, picture


def _pairs(recording: Path, stabilized: Path) -> Iterator[tuple[Frame, Frame]]:
    """Every frame as recorded and as stabilised; skips frames without a stabilised image."""
    with open_source(recording) as source, open_bag(stabilized) as bag:
        raws = (item.decoded for item in source.frames())
        for message in bag.messages({STABILIZED}):
            steady = read_image(message.data, IMAGE)
            same = (raw for raw in raws if isinstance(raw, Frame) and raw.stamp_ns == steady.stamp_ns)
            raw = next(same, None)
            if raw is None:
                raise WorkError(f"{stabilized}: its pictures are not those of {recording}")
            yield raw, steady


class _Stack:
    """The mean of many images, and one line of each; side by side, static ground gives straight lines."""

    def __init__(self) -> None:
        self._sum: FloatArray = np.zeros(())
        self._lines: list[Image] = []

    def add(self, image: Image) -> None:
        self._sum = self._sum + image[_MEAN]
        self._lines.append(image[_SLICE_ROWS, _SLICE_X].copy())

    @property
    def count(self) -> int:
        return len(self._lines)

    def mean(self) -> Image:
        return np.asarray(np.round(self._sum / self.count), np.uint8)

    def over_time(self) -> Image:
        return np.stack(self._lines, axis=1)


def _four_parts(before: _Stack, after: _Stack) -> Image:
    mean, line = "mean of all frames", "one line of the picture over time"
    means = _row([_panel(before.mean(), f"{mean}, as recorded"), _panel(after.mean(), "stabilised")])
    lines = _row([_panel(before.over_time(), f"{line}, as recorded"), _panel(after.over_time(), "stabilised")])
    gap = np.full((_GAP_PX, means.shape[1], 3), 255, np.uint8)
    return np.vstack([means, gap, lines])


def _row(panels: list[Image]) -> Image:
    gap = np.full((_PANEL[1], _GAP_PX, 3), 255, np.uint8)
    return np.hstack([panels[0], gap, panels[1]])


def _panel(image: Image, title: str) -> Image:
    return _titled(np.asarray(cv2.resize(image, _PANEL, interpolation=cv2.INTER_NEAREST)), title)


def _titled(image: Image, title: str) -> Image:
    titled = image.copy()
    titled[:_TITLE_PX] //= 3
    cv2.putText(titled, title, (10, _TITLE_PX - 9), cv2.FONT_HERSHEY_SIMPLEX, 0.55, (255, 255, 255), 1, cv2.LINE_AA)
    return titled
