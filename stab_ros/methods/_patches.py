"""Square patches of the reference and the measurement of how far each one has moved: the heart of `direct`.

Inverse compositional alignment (Baker and Matthews 2004, section 3.2.1), one 2-vector a patch instead of one
parameter vector for all: the template's gradient is the test function, so nothing but the sampling of the current
frame is done per frame. Brightness and contrast of each patch drop out because mean and template are projected out of
the gradient beforehand.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numba
import numpy as np

from stab_ros.core.types import BoolArray, FloatArray, Gray, Homography, IdArray

_BORDER = 3  # px that the gradient and the interpolation reach beyond the patch
_QUANTISATION = 1.0 / 12  # variance of rounding to whole grey levels


@dataclass(frozen=True, eq=False)
class Patches:
    """N patches of (2 radius + 1)^2 px about integer `centres` (N, 2).

    template: (N, s, s) float32, zero mean. slope: (2, N, s, s) float32, the template's x and y gradient with mean and
    template projected out. power: (N,) sum of template^2. stiffness: (N, 2, 2) sum of slope slope^T.
    """

    centres: IdArray
    radius: int
    template: FloatArray
    slope: FloatArray
    power: FloatArray
    stiffness: FloatArray

    def __len__(self) -> int:
        return len(self.centres)


@dataclass(frozen=True, eq=False)
class Measured:
    """What one pass found, for the N patches.

    displacement: (N, 2) px, of the current picture against the template, reference side. correlation: (N,) normalised
    cross-correlation with the template, 0 where the patch left the picture. information: (N, 2, 2), 1/px^2.
    """

    displacement: FloatArray
    correlation: FloatArray
    information: FloatArray


def texture(gray: Gray, radius: int) -> FloatArray:
    """Mean squared gradient along the weaker direction of the window about each pixel: (h, w) float32.

    The smaller eigenvalue of the structure tensor (Shi and Tomasi 1994), grey levels^2 per px^2.
    """
    side = 2 * radius + 1
    per_sobel = 1.0 / (4 * side * 255)  # cv2's own scaling of its 3x3 Sobel for 8-bit pictures
    eigenvalue = cv2.cornerMinEigenVal(gray, side, ksize=3)
    return np.asarray(eigenvalue * np.float32((1 / (8 * per_sobel * side)) ** 2))


def choose(gray: Gray, allowed: BoolArray, count: int, radius: int, least_texture: float) -> IdArray:
    """Centres (n, 2) of at most `count` patches: the best-textured place of each cell of an even grid.

    The cells are as large as lets `count` of them cover what `allowed` leaves.
    """
    score = texture(gray, radius)
    margin = radius + _BORDER
    usable = np.zeros(gray.shape, bool)
    usable[margin:-margin, margin:-margin] = allowed[margin:-margin, margin:-margin]
    score[~usable] = 0
    side = max(radius, int(np.sqrt(usable.sum() / count)))
    height, width = -(-gray.shape[0] // side) * side, -(-gray.shape[1] // side) * side
    padded = np.zeros((height, width), np.float32)
    padded[: gray.shape[0], : gray.shape[1]] = score
    cells = padded.reshape(height // side, side, width // side, side).swapaxes(1, 2).reshape(-1, side * side)
    best, where = cells.max(axis=1), cells.argmax(axis=1)
    row, column = np.divmod(np.arange(len(cells)), width // side)
    y, x = np.divmod(where, side)
    strongest = np.argsort(-best, kind="stable")[:count]
    strongest = np.sort(strongest[best[strongest] >= least_texture])
    return np.stack([column * side + x, row * side + y], axis=1)[strongest].astype(np.int64)


def cut(gray: Gray, centres: IdArray, radius: int) -> Patches:
    """The patches of `gray` about `centres`, which keep clear of the border as those of `choose` do."""
    span = np.arange(-radius - 2, radius + 3)
    rows = centres[:, 1, None, None] + span[None, :, None]
    columns = centres[:, 0, None, None] + span[None, None, :]
    wide = gray[rows, columns].astype(np.float64)
    inner = slice(2, -2)
    template = wide[:, inner, inner] - wide[:, inner, inner].mean(axis=(1, 2), keepdims=True)
    slope = np.stack([_derivative(wide, 2)[:, inner, :], _derivative(wide, 1)[:, :, inner]])
    slope -= slope.mean(axis=(2, 3), keepdims=True)
    power = np.maximum(np.einsum("nij,nij->n", template, template), 1e-9)
    slope -= (np.einsum("dnij,nij->dn", slope, template) / power)[:, :, None, None] * template
    stiffness = np.einsum("anij,bnij->nab", slope, slope)
    return Patches(centres, radius, template.astype(np.float32), slope.astype(np.float32), power, stiffness)


def _derivative(wide: FloatArray, axis: int) -> FloatArray:
    """Fourth-order central difference, exact for cubics; two px shorter at either end of `axis`."""
    n = wide.shape[axis]
    at = [np.take(wide, np.arange(k, n - 4 + k), axis=axis) for k in range(5)]
    return np.asarray((at[0] - 8 * at[1] + 8 * at[3] - at[4]) / 12)


def measure(patches: Patches, gray: Gray, cur_H_ref: Homography, cubic: bool) -> Measured:
    """Sample `gray` where `cur_H_ref` says each patch is, and see how far off that was."""
    n = len(patches)
    displacement, correlation, information = np.zeros((n, 2)), np.zeros(n), np.zeros((n, 2, 2))
    _measure(gray, cur_H_ref, patches.centres, patches.radius, patches.template, patches.slope, patches.power,
             patches.stiffness, cubic, displacement, correlation, information)
    return Measured(displacement, correlation, information)


@numba.njit(cache=True, nogil=True, parallel=True, fastmath=True)
def _measure(gray: Gray, H: Homography, centres: IdArray, radius: int, template: FloatArray, slope: FloatArray,
             power: FloatArray, stiffness: FloatArray, cubic: bool,
             displacement: FloatArray, correlation: FloatArray, information: FloatArray) -> None:
    """Fill the last three arrays; a patch that is not wholly inside the picture, or flat there, stays at zero."""
    height, width = gray.shape
    side = 2 * radius + 1
    count = np.float32(side * side)
    for p in numba.prange(len(centres)):
        cx, cy = float(centres[p, 0]), float(centres[p, 1])
        w = H[2, 0] * cx + H[2, 1] * cy + H[2, 2]
        if w <= 0:
            continue
        px, py = (H[0, 0] * cx + H[0, 1] * cy + H[0, 2]) / w, (H[1, 0] * cx + H[1, 1] * cy + H[1, 2]) / w
        # the homography's derivative at the centre: over a patch the rest is below 0.001 px
        xx, xy = (H[0, 0] - px * H[2, 0]) / w, (H[0, 1] - px * H[2, 1]) / w
        yx, yy = (H[1, 0] - py * H[2, 0]) / w, (H[1, 1] - py * H[2, 1]) / w
        reach_x, reach_y = radius * (abs(xx) + abs(xy)), radius * (abs(yx) + abs(yy))
        if not (px - reach_x >= 1 and py - reach_y >= 1 and px + reach_x < width - 3 and py + reach_y < height - 3):
            continue
        total, square, along = np.float32(0), np.float32(0), np.float32(0)
        slope_x, slope_y = np.float32(0), np.float32(0)
        for row in range(side):
            x0 = px + xy * (row - radius) - xx * radius
            y0 = py + yy * (row - radius) - yx * radius
            for column in range(side):
                x, y = x0 + xx * column, y0 + yx * column
                ix, iy = int(x), int(y)
                fx, fy = np.float32(x - ix), np.float32(y - iy)
                if cubic:
                    value = _cubic(gray, ix, iy, fx, fy)
                else:
                    value = _linear(gray, ix, iy, fx, fy)
                total += value
                square += value * value
                along += template[p, row, column] * value
                slope_x += slope[0, p, row, column] * value
                slope_y += slope[1, p, row, column] * value
        variance = square - total * total / count
        if variance <= 0 or along <= 0:
            continue
        gain = along / power[p]
        a, b, c = stiffness[p, 0, 0], stiffness[p, 0, 1], stiffness[p, 1, 1]
        det = a * c - b * b
        if det <= 1e-6 * a * c:
            continue
        dx, dy = -(c * slope_x - b * slope_y) / (det * gain), -(a * slope_y - b * slope_x) / (det * gain)
        left = variance - along * gain + gain * (dx * slope_x + dy * slope_y)  # what neither template nor motion explain
        noise = max(left, 0.0) / (count - 4) + _QUANTISATION
        displacement[p, 0], displacement[p, 1] = dx, dy
        correlation[p] = along / np.sqrt(variance * power[p])
        information[p, 0, 0], information[p, 1, 1] = gain * gain * a / noise, gain * gain * c / noise
        information[p, 0, 1] = information[p, 1, 0] = gain * gain * b / noise


@numba.njit(cache=True, nogil=True, fastmath=True, inline="always")
def _linear(gray: Gray, x: int, y: int, fx: float, fy: float) -> float:
    top = gray[y, x] + fx * (np.float32(gray[y, x + 1]) - np.float32(gray[y, x]))
    bottom = gray[y + 1, x] + fx * (np.float32(gray[y + 1, x + 1]) - np.float32(gray[y + 1, x]))
    return np.float32(top + fy * (bottom - top))


@numba.njit(cache=True, nogil=True, fastmath=True, inline="always")
def _cubic(gray: Gray, x: int, y: int, fx: float, fy: float) -> float:
    """Cubic convolution, a = -1/2 (Keys 1981): its error is of third order, bilinear's biases 0.01 px and more."""
    x0, x1, x2, x3 = _keys(fx)
    y0, y1, y2, y3 = _keys(fy)
    r0 = x0 * gray[y - 1, x - 1] + x1 * gray[y - 1, x] + x2 * gray[y - 1, x + 1] + x3 * gray[y - 1, x + 2]
    r1 = x0 * gray[y, x - 1] + x1 * gray[y, x] + x2 * gray[y, x + 1] + x3 * gray[y, x + 2]
    r2 = x0 * gray[y + 1, x - 1] + x1 * gray[y + 1, x] + x2 * gray[y + 1, x + 1] + x3 * gray[y + 1, x + 2]
    r3 = x0 * gray[y + 2, x - 1] + x1 * gray[y + 2, x] + x2 * gray[y + 2, x + 1] + x3 * gray[y + 2, x + 2]
    return np.float32(y0 * r0 + y1 * r1 + y2 * r2 + y3 * r3)


@numba.njit(cache=True, nogil=True, fastmath=True, inline="always")
def _keys(f: float) -> tuple[float, float, float, float]:
    half, one = np.float32(0.5), np.float32(1)
    g = one - f
    return (-half * f * g * g, one + f * f * (np.float32(1.5) * f - np.float32(2.5)),
            one + g * g * (np.float32(1.5) * g - np.float32(2.5)), -half * g * f * f)
