"""Compiles kernels and loads tables before the first frame of the stream has to wait for them."""

from __future__ import annotations

from collections.abc import Mapping

import cv2
import numpy as np

from stab_ros.core.config import Value
from stab_ros.core.evaluation import Arrival
from stab_ros.core.types import Frame, Gray, Image
from stab_ros.io.engine import make_evaluator, make_stabilizer
from stab_ros.io.messages import IMAGE, Header, image_cdr, read_image

_SIZE = (320, 240)
_START = 4  # frames
_COLOURED = {"bgr8": cv2.COLOR_GRAY2BGR, "bgra8": cv2.COLOR_GRAY2BGRA}
_OF_THE_STREAM = ("roi", "exclude", "points_file", "manual_points")  # what refers to pixels of the real reference


def warm_up(values: Mapping[str, Value]) -> None:
    """Leads an engine with these settings through a start and beyond it, once in gray and once in colour."""
    for encoding in ("mono8", "bgr8"):  # received gray is read-only memory, a kernel of its own
        stabilizer = make_stabilizer(_of_any_stream(values))
        for stamp_ns in range(_START):
            stabilizer.answers(_received(_texture(shift_px=stamp_ns), encoding, stamp_ns))
        stabilizer.finish()
        track = stabilizer.step(_received(_texture(shift_px=_START), encoding, _START)).track
        for other in ("bgra8", "mono16"):  # the same to the tracker, but warped by kernels of their own
            stabilizer.warp(_received(_texture(shift_px=0), other, 0), track)


def warm_up_evaluator(values: Mapping[str, Value]) -> None:
    """Lets an evaluator with these settings measure a picture against another, RMSE and velocity field included."""
    evaluator = make_evaluator(_of_any_stream(values))
    for index in range(2):
        frame = _received(_texture(shift_px=index), "mono8", index)
        evaluator.step(Arrival(index, index, np.eye(3), lost=False, frame=frame))


def _of_any_stream(values: Mapping[str, Value]) -> dict[str, Value]:
    return {name: value for name, value in values.items() if name not in _OF_THE_STREAM}


def _texture(shift_px: int) -> Gray:
    noise = np.random.default_rng(1).integers(0, 256, (_SIZE[1], _SIZE[0]), np.uint8)
    smooth = cv2.normalize(cv2.GaussianBlur(noise, (0, 0), 3), None, 0, 255, cv2.NORM_MINMAX)
    return np.roll(np.asarray(smooth, np.uint8), shift_px, axis=1)


def _received(gray: Gray, encoding: str, stamp_ns: int) -> Frame:
    image: Image = gray.astype(np.uint16) if encoding == "mono16" else gray
    if encoding in _COLOURED:
        image = cv2.cvtColor(gray, _COLOURED[encoding])
    return read_image(image_cdr(image, encoding, Header(stamp_ns)), IMAGE)
