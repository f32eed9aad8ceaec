"""Gradient by ratio and the SAR-Harris corner detector (Dellinger et al. 2015, section III).

Speckle is multiplicative: differences of grey levels grow with brightness, but ratios of the means on both sides of a
pixel do not. The means are one-sided and exponentially weighted (ROEWA, Fjortoft et al. 1998) at a scale alpha, px.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from stab_ros.core.types import Float32Array, FloatArray, Gray

FINEST_PX = 2.0  # alpha of the finest scale
STEP = 2.0 ** (1 / 3)
_HARRIS = 0.04  # weight of the trace
_KERNEL_RADIUS = 3.0  # in alpha; the exponential has fallen to 5 % there
_MAX_SUBPIXEL_PX = 0.6  # largest offset of a parabola's vertex from its pixel
_BORDER_PX = 2


@dataclass(frozen=True, eq=False)
class RatioGradient:
    """The gradient by ratio at one scale.

    Attributes:
        alpha_px: the scale.
        right, down: (h, w) float32, logarithm of the ratio of the means on both sides, along x and along y.
    """

    alpha_px: float
    right: Float32Array
    down: Float32Array


def ratio_gradient(gray: Gray, alpha_px: float) -> RatioGradient:
    """The gradient by ratio of an image (h, w) uint8 at scale `alpha_px`."""
    image = gray.astype(np.float32) + 1  # speckle may be black
    reach = round(_KERNEL_RADIUS * alpha_px)
    both = np.exp(-np.abs(np.arange(-reach, reach + 1)) / alpha_px).astype(np.float32)
    after = np.where(np.arange(-reach, reach + 1) > 0, both, np.float32(0))
    right, left, down, up = (
        cv2.sepFilter2D(image, cv2.CV_32F, kernel_x, kernel_y, borderType=cv2.BORDER_REFLECT)
        for kernel_x, kernel_y in ((after, both), (after[::-1], both), (both, after), (both, after[::-1]))
    )
    return RatioGradient(alpha_px, np.log(right / left), np.log(down / up))


def corners(scale: RatioGradient, threshold: float) -> tuple[FloatArray, FloatArray]:
    """Sub-pixel positions (n, 2), px, and responses (n,) of the maxima of the SAR-Harris function above `threshold`."""
    response = _harris(scale)
    peak = (response == cv2.dilate(response, np.ones((3, 3), np.uint8))) & (response > threshold)
    peak[:_BORDER_PX] = peak[-_BORDER_PX:] = peak[:, :_BORDER_PX] = peak[:, -_BORDER_PX:] = False
    row, column = np.nonzero(peak)
    middle = response[row, column]
    x = column + _parabola(response[row, column - 1], middle, response[row, column + 1])
    y = row + _parabola(response[row - 1, column], middle, response[row + 1, column])
    return np.stack([x, y], axis=1), middle.astype(np.float64)


def _harris(scale: RatioGradient) -> Float32Array:
    """SAR-Harris function det C - d tr(C)^2, C the structure tensor of the ratio gradient times alpha^2."""
    sigma = np.sqrt(2) * scale.alpha_px
    xx, xy, yy = (cv2.GaussianBlur(product, (0, 0), sigma) * np.float32(scale.alpha_px**2)
                  for product in (scale.right**2, scale.right * scale.down, scale.down**2))
    return np.asarray(xx * yy - xy * xy - np.float32(_HARRIS) * (xx + yy) ** 2)


def _parabola(before: Float32Array, middle: Float32Array, after: Float32Array) -> FloatArray:
    """Offset of the vertex of the parabola through three values from the middle one, px."""
    curvature = (2.0 * middle - before - after).astype(np.float64)
    offset = (after - before) / np.where(curvature > 0, 2 * curvature, np.inf)
    return np.asarray(np.clip(offset, -_MAX_SUBPIXEL_PX, _MAX_SUBPIXEL_PX))
