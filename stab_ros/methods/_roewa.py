"""Gradients by ratio and the corners they make: SAR-Harris (Dellinger et al. 2015, section III).

Speckle multiplies, so differences of grey levels are large wherever it is bright; ratios of the means on either side
are not. The means are exponentially weighted (ROEWA, Fjortoft et al. 1998), one-sided, at a scale alpha in px.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from stab_ros.core.types import FloatArray, Gray

Floats: TypeAlias = NDArray[np.float32]

FINEST_PX = 2.0  # alpha of the finest scale
STEP = 2.0 ** (1 / 3)
_HARRIS = 0.04  # weight of the trace
_REACH = 3.0  # of the exponential, in alpha: there it has fallen to 5 %
_FARTHEST_PX = 0.6  # of a parabola's peak from its pixel
_BORDER_PX = 2


@dataclass(frozen=True, eq=False)
class Scale:
    """The gradient by ratio at one scale: (h, w) float32 logarithms of the ratio of means, to the right and down."""

    alpha_px: float
    right: Floats
    down: Floats


def scale_of(gray: Gray, alpha_px: float) -> Scale:
    """The gradient of a picture (h, w) uint8 at scale alpha."""
    picture = gray.astype(np.float32) + 1  # speckle can be black
    reach = round(_REACH * alpha_px)
    both = np.exp(-np.abs(np.arange(-reach, reach + 1)) / alpha_px).astype(np.float32)
    after = np.where(np.arange(-reach, reach + 1) > 0, both, np.float32(0))
    right, left, down, up = (
        cv2.sepFilter2D(picture, cv2.CV_32F, kernel_x, kernel_y, borderType=cv2.BORDER_REFLECT)
        for kernel_x, kernel_y in ((after, both), (after[::-1], both), (both, after), (both, after[::-1]))
    )
    return Scale(alpha_px, np.log(right / left), np.log(down / up))


def corners(scale: Scale, threshold: float) -> tuple[FloatArray, FloatArray]:
    """Places (n, 2) and responses (n,) of the maxima of the SAR-Harris function above the threshold."""
    response = _harris(scale)
    peak = (response == cv2.dilate(response, np.ones((3, 3), np.uint8))) & (response > threshold)
    peak[:_BORDER_PX] = peak[-_BORDER_PX:] = peak[:, :_BORDER_PX] = peak[:, -_BORDER_PX:] = False
    row, column = np.nonzero(peak)
    middle = response[row, column]
    x = column + _parabola(response[row, column - 1], middle, response[row, column + 1])
    y = row + _parabola(response[row - 1, column], middle, response[row + 1, column])
    return np.stack([x, y], axis=1), middle.astype(np.float64)


def _harris(scale: Scale) -> Floats:
    """SAR-Harris: det C - d tr(C)^2, C the structure tensor of the ratio gradient; alpha^2 makes scales comparable."""
    sigma = np.sqrt(2) * scale.alpha_px
    xx, xy, yy = (cv2.GaussianBlur(product, (0, 0), sigma) * np.float32(scale.alpha_px**2)
                  for product in (scale.right**2, scale.right * scale.down, scale.down**2))
    return np.asarray(xx * yy - xy * xy - np.float32(_HARRIS) * (xx + yy) ** 2)


def _parabola(before: Floats, middle: Floats, after: Floats) -> FloatArray:
    """Where the parabola through three values has its peak, from the middle one."""
    bend = (2.0 * middle - before - after).astype(np.float64)
    offset = (after - before) / np.where(bend > 0, 2 * bend, np.inf)
    return np.asarray(np.clip(offset, -_FARTHEST_PX, _FARTHEST_PX))
