"""From any decoded picture to the 8-bit gray the methods work on."""

from __future__ import annotations

import dataclasses

import cv2
import numpy as np

from stab_ros.core.types import Frame, Gray

_TO_GRAY = {
    "bgr8": cv2.COLOR_BGR2GRAY,
    "rgb8": cv2.COLOR_RGB2GRAY,
    "bgra8": cv2.COLOR_BGRA2GRAY,
    "rgba8": cv2.COLOR_RGBA2GRAY,
}
_FULL_8_BIT = 255.0


def depth_scale(frame: Frame) -> float:
    """The factor from the frame's grey levels to 8 bit; a 16-bit sensor seldom fills its range, so it is measured.

    Fixed by the reference and used for all frames after it, so that brightness stays comparable.
    """
    if frame.encoding != "mono16" or not frame.image.size:
        return 1.0
    brightest = float(np.percentile(frame.image[::4, ::4], 99.9))
    return 0.9 * _FULL_8_BIT / brightest if brightest > 0 else 1.0


def to_gray(frame: Frame, scale: float = 1.0) -> Gray:
    """(h, w) uint8; mono8 is passed on without a copy."""
    if frame.encoding == "mono8":
        return frame.image
    if frame.encoding == "mono16":
        return np.asarray(cv2.convertScaleAbs(frame.image, alpha=scale))
    return np.asarray(cv2.cvtColor(frame.image, _TO_GRAY[frame.encoding]))


def without_colour(frame: Frame) -> Frame:
    """The frame as mono8 where it has colour: all that is measured is in it, in a third of the memory."""
    if frame.encoding not in _TO_GRAY:
        return frame
    return dataclasses.replace(frame, image=to_gray(frame), encoding="mono8")
