"""Conversion of decoded images to the 8-bit gray images that the methods use."""

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
    """Factor from the frame's grey levels to 8 bits.

    It is 1 for 8-bit frames. For mono16 it is measured, because a 16-bit sensor rarely uses its full range. The factor
    of the reference is used for all later frames, so that brightness remains comparable.
    """
    if frame.encoding != "mono16" or not frame.image.size:
        return 1.0
    brightest = float(np.percentile(frame.image[::4, ::4], 99.9))
    return 0.9 * _FULL_8_BIT / brightest if brightest > 0 else 1.0


def to_gray(frame: Frame, scale: float = 1.0) -> Gray:
    """The frame as gray (h, w) uint8; mono8 images are not copied. scale: from `depth_scale`, for mono16."""
    if frame.encoding == "mono8":
        return frame.image
    if frame.encoding == "mono16":
        return np.asarray(cv2.convertScaleAbs(frame.image, alpha=scale))
    return np.asarray(cv2.cvtColor(frame.image, _TO_GRAY[frame.encoding]))


def without_colour(frame: Frame) -> Frame:
    """The frame as mono8 if it has colour, which needs a third of the memory; otherwise the frame itself."""
    if frame.encoding not in _TO_GRAY:
        return frame
    return dataclasses.replace(frame, image=to_gray(frame), encoding="mono8")
