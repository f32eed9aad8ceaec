"""Square patches of the reference and the measurement of how far each one has moved: the heart of `direct`.

Inverse compositional alignment (Baker and Matthews 2004, section 3.2.1), one 2-vector a patch instead of one
parameter vector for all: all derivatives are the template's, so nothing but the sampling of the current frame is done
per frame. Brightness and contrast of each patch drop out because mean and template are projected out beforehand.

The displacement is read with a test function that is smoother than the gradient (an instrumental variable; the same as
smoothing both pictures, at no cost per frame): the finest wavelengths are what sampling has aliased and what
interpolation bends, and with them the result leans by 0.015 px towards or away from whole pixels.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from stab_ros.core.geometry import apply
from stab_ros.core.kernels import F32, F64, I64, U8, filled, inlined, kernel, read
from stab_ros.core.threads import in_parallel
from stab_ros.core.types import BoolArray, FloatArray, Gray, Homography, IdArray, Image

_BAND_ROWS = 128  # of the picture that are looked at together
_SMOOTHING_PX, _BLUR_REACH = 2.0, 8  # of the test function: as if both pictures were smoothed by 1.4
_AHEAD = 256  # px, more than any sample lies before its patch centre
_NEARLY_SHIFTED_PX = 0.12  # turned and stretched by less at its edge, a patch is sampled as if only shifted
# What is left in a patch is correlated from pixel to pixel (interpolation, aliasing), and the smooth test function
# picks up just that. Measured: without this factor, the displacements on the synthetic scenes have a chi-square per
# degree of freedom of 2.2 to 2.5, whatever the noise (0 to 4 grey levels).
_CORRELATION = 2.3
_WORTH_A_THREAD = 100  # patches
_QUANTISATION = 1.0 / 12  # variance of rounding to whole grey levels


@dataclass(frozen=True, eq=False)
class Patches:
    """N patches of (2 radius + 1)^2 px about integer `centres` (N, 2).

    template: (N, s, s) float32, zero mean. power: (N,) sum of template^2.
    pull: (2, N, s, s) float32, orthogonal to a constant and to the template: the sum of pull and picture is the
    displacement in px. precision: (N, 2, 2) inverse of the sum of pull pull^T: information at unit noise.
    lever: (N, 2, 4) displacement that a picture deformed by u(x) = M x about the centre seems to have, by mxx, mxy, myx
    and myy.
    """

    centres: IdArray
    radius: int
    template: FloatArray
    power: FloatArray
    pull: FloatArray
    precision: FloatArray
    lever: FloatArray

    def __len__(self) -> int:
        return len(self.centres)

    def __getitem__(self, keep: BoolArray) -> Patches:
        return Patches(self.centres[keep], self.radius, self.template[keep], self.power[keep],
                       np.compress(keep, self.pull, axis=1), self.precision[keep], self.lever[keep])


@dataclass(frozen=True, eq=False)
class Measured:
    """What one pass found, for N chosen patches.

    displacement: (N, 2) px, of the current picture against the template, reference side. correlation: (N,) normalised
    cross-correlation with the template, 0 where the patch left the picture. information: (N, 2, 2), 1/px^2.
    """

    chosen: IdArray
    displacement: FloatArray
    correlation: FloatArray
    information: FloatArray


def cut_patches(gray: Gray, centres: IdArray, radius: int) -> Patches:
    """The patches of `gray` about `centres`, which keep clear of the border as those of `choose` do.

    Those that determine no displacement are left out. Band by band of the picture: nothing large is needed beside it.
    """
    n, side = len(centres), 2 * radius + 1
    patches = Patches(centres, radius, np.empty((n, side, side), np.float32), np.empty(n),
                      np.empty((2, n, side, side), np.float32), np.empty((n, 2, 2)), np.empty((n, 2, 4)))
    usable, band = np.zeros(n, bool), centres[:, 1] // _BAND_ROWS
    for number in np.unique(band):
        _fill(patches, usable, np.flatnonzero(band == number), gray)
    return patches if usable.all() else patches[usable]


def _fill(patches: Patches, usable: BoolArray, which: IdArray, gray: Gray) -> None:
    """Some of the patches, all of one band of the picture, and whether they can be used."""
    radius = patches.radius
    rows, centres = _band(gray, patches.centres[which], radius + 2 + _BLUR_REACH)
    template = _windows(rows, centres, radius)
    template -= template.mean(axis=(1, 2), keepdims=True)
    power = np.maximum(np.einsum("nij,nij->n", template, template), 1e-9)
    gradient = _gradient(rows, centres, radius)
    test = _gradient(cv2.GaussianBlur(rows.astype(np.float32), (0, 0), _SMOOTHING_PX), centres, radius)
    gradient, test = (_without_brightness(image, template, power) for image in (gradient, test))
    response = np.einsum("anij,bnij->nab", test, gradient)
    good = np.abs(np.linalg.det(response)) > 1e-6 * response[:, 0, 0] * response[:, 1, 1]
    pull = -np.einsum("nab,bnij->anij", np.linalg.inv(response[good]), test[:, good])
    along = np.arange(-radius, radius + 1.0)
    moments = np.stack([gradient[:, good] * along, gradient[:, good] * along[:, None]], axis=1)  # by x and by y
    which, usable[which] = which[good], good
    patches.template[which], patches.power[which], patches.pull[:, which] = template[good], power[good], pull
    patches.precision[which] = np.linalg.inv(np.einsum("anij,bnij->nab", pull, pull))
    patches.lever[which] = -np.einsum("anij,dmnij->nadm", pull, moments).reshape(-1, 2, 4)


def _band(gray: Gray, centres: IdArray, reach: int) -> tuple[Gray, IdArray]:
    """The rows of the picture that lie within `reach` of any of the centres, and where those are in them."""
    top = max(0, int(centres[:, 1].min()) - reach)
    return gray[top : int(centres[:, 1].max()) + reach + 1], centres - np.array([0, top])


def _without_brightness(images: FloatArray, template: FloatArray, power: FloatArray) -> FloatArray:
    """(2, N, s, s) images made orthogonal to a constant and to the template."""
    centred = images - images.mean(axis=(2, 3), keepdims=True)
    along = np.einsum("dnij,nij->dn", centred, template) / power
    return np.asarray(centred - along[:, :, None, None] * template)


def _windows(image: Image, centres: IdArray, radius: int) -> FloatArray:
    """(N, 2 radius + 1, 2 radius + 1) float64."""
    span = np.arange(-radius, radius + 1)
    rows = centres[:, 1, None, None] + span[None, :, None]
    columns = centres[:, 0, None, None] + span[None, None, :]
    return np.asarray(image[rows, columns], np.float64)


def _gradient(image: Image, centres: IdArray, radius: int) -> FloatArray:
    """Windows of the x and of the y derivative: (2, N, s, s)."""
    wide, inner = _windows(image, centres, radius + 2), slice(2, -2)
    return np.stack([_derivative(wide, 2)[:, inner, :], _derivative(wide, 1)[:, :, inner]])


def _derivative(wide: FloatArray, axis: int) -> FloatArray:
    """Fourth-order central difference, exact for cubics; two px shorter at either end of `axis`."""
    n = wide.shape[axis]
    at = [np.take(wide, np.arange(k, n - 4 + k), axis=axis) for k in range(5)]
    return np.asarray((at[0] - 8 * at[1] + 8 * at[3] - at[4]) / 12)


def measure_patches(patches: Patches, chosen: IdArray, gray: Gray, cur_H_ref: Homography,
            at_px: FloatArray | None = None) -> Measured:
    """Sample `gray` where `cur_H_ref` says each of the `chosen` patches is, and see how far off that was.

    at_px: (N, 2) where each is instead; `cur_H_ref` then only says how it is turned and stretched.
    """
    n, chosen = len(chosen), np.ascontiguousarray(chosen)
    at_px = apply(cur_H_ref, patches.centres[chosen].astype(np.float64)) if at_px is None else at_px
    measured = Measured(chosen, np.zeros((n, 2)), np.zeros(n), np.zeros((n, 2, 2)))

    def part(first: int, last: int) -> None:
        these = slice(first, last)
        _measure(gray, cur_H_ref, at_px[these], chosen[these], patches.centres, patches.radius, patches.template,
                 patches.power, patches.pull, patches.precision, patches.lever, measured.displacement[these],
                 measured.correlation[these], measured.information[these])

    in_parallel(part, n, _WORTH_A_THREAD)
    return measured


# The helpers below are inlined: linked separately, a freshly compiled kernel and one from numba's cache would round
# differently, and the live homographies would not be the command's.
@kernel((read(U8, 2), read(F64, 2), read(F64, 2), read(I64, 1), read(I64, 2), I64, read(F32, 3), read(F64, 1),
         read(F32, 4), read(F64, 3), read(F64, 3), filled(F64, 2), filled(F64, 1), filled(F64, 3)), fastmath=True)
def _measure(gray: Gray, H: Homography, at_px: FloatArray, chosen: IdArray, centres: IdArray, radius: int,
             template: FloatArray, power: FloatArray, pull: FloatArray, precision: FloatArray, lever: FloatArray,
             displacement: FloatArray, correlation: FloatArray, information: FloatArray) -> None:
    """Fill the last three arrays; a patch that is not wholly inside the picture, or flat there, stays at zero."""
    height, width = gray.shape
    count = (2 * radius + 1) ** 2
    for i in range(len(chosen)):
        p = chosen[i]
        cx, cy = float(centres[p, 0]), float(centres[p, 1])
        w = H[2, 0] * cx + H[2, 1] * cy + H[2, 2]
        if w <= 0:
            continue
        px, py = at_px[i, 0], at_px[i, 1]
        # the homography's derivative at the centre: over a patch the rest is below 0.001 px
        hx, hy = (H[0, 0] * cx + H[0, 1] * cy + H[0, 2]) / w, (H[1, 0] * cx + H[1, 1] * cy + H[1, 2]) / w
        xx, xy = (H[0, 0] - hx * H[2, 0]) / w, (H[0, 1] - hx * H[2, 1]) / w
        yx, yy = (H[1, 0] - hy * H[2, 0]) / w, (H[1, 1] - hy * H[2, 1]) / w
        reach_x, reach_y = radius * (abs(xx) + abs(xy)), radius * (abs(yx) + abs(yy))
        if not (px - reach_x >= 1 and py - reach_y >= 1 and px + reach_x < width - 3 and py + reach_y < height - 3):
            continue
        det = xx * yy - xy * yx
        bend = np.array([1 - yy / det, xy / det, yx / det, 1 - xx / det])  # 1 - A^-1, A the derivative
        nearly_shifted = np.max(np.abs(bend)) * radius < _NEARLY_SHIFTED_PX
        values = np.empty(count, np.float32)
        if nearly_shifted:
            _sample_shifted(gray, px, py, radius, values)
        else:
            _sample(gray, px, py, xx, xy, yx, yy, radius, values)
        total, square, along, pull_x, pull_y = _sums(values, template[p].ravel(), pull[0, p].ravel(),
                                                     pull[1, p].ravel())
        variance = square - total * total / count
        if variance <= 0 or along <= 0:
            continue
        gain = along / power[p]
        noise = _CORRELATION * (max(variance - along * gain, 0.0) / (count - 2) + _QUANTISATION)
        displacement[i, 0], displacement[i, 1] = pull_x / gain, pull_y / gain
        if nearly_shifted:
            for a in range(2):
                for m in range(4):
                    displacement[i, a] -= lever[p, a, m] * bend[m]
        correlation[i] = along / np.sqrt(variance * power[p])
        for a in range(2):
            for b in range(2):
                information[i, a, b] = precision[p, a, b] * gain * gain / noise


@inlined(fastmath=True)
def _sample(gray: Gray, px: float, py: float, xx: float, xy: float, yx: float, yy: float, radius: int,
            values: FloatArray) -> None:
    """Bilinear samples on the grid of a patch about (px, py), which the affine part maps into the picture.

    Places first, then values: each loop runs in SIMD registers, together they would not.
    """
    count = len(values)
    place, fx, fy = np.empty(count, np.int32), np.empty(count, np.float32), np.empty(count, np.float32)
    width, base_x, base_y = gray.shape[1], int(px) - _AHEAD, int(py) - _AHEAD
    start_x, start_y = np.float32(px - base_x), np.float32(py - base_y)
    step_xx, step_xy, step_yx, step_yy = np.float32(xx), np.float32(xy), np.float32(yx), np.float32(yy)
    k = 0
    for row in range(-radius, radius + 1):
        for column in range(-radius, radius + 1):
            x = start_x + step_xx * np.float32(column) + step_xy * np.float32(row)
            y = start_y + step_yx * np.float32(column) + step_yy * np.float32(row)
            whole_x, whole_y = np.int32(x), np.int32(y)  # positive thanks to _AHEAD, so this is the floor
            place[k] = whole_y * width + whole_x
            fx[k], fy[k] = x - np.float32(whole_x), y - np.float32(whole_y)
            k += 1
    pixels, origin = gray.ravel(), base_y * width + base_x
    for k in range(count):
        at = origin + place[k]
        first, second = np.float32(pixels[at]), np.float32(pixels[at + 1])
        third, fourth = np.float32(pixels[at + width]), np.float32(pixels[at + width + 1])
        top, bottom = first + fx[k] * (second - first), third + fx[k] * (fourth - third)
        values[k] = top + fy[k] * (bottom - top)


@inlined(fastmath=True)
def _sample_shifted(gray: Gray, px: float, py: float, radius: int, values: FloatArray) -> None:
    """Bilinear samples of a patch about (px, py) that is only shifted: one set of weights, contiguous loads."""
    column, row, side = int(px) - radius, int(py) - radius, 2 * radius + 1
    fx, fy = np.float32(px - int(px)), np.float32(py - int(py))
    one = np.float32(1)
    first, second, third, fourth = (one - fx) * (one - fy), fx * (one - fy), (one - fx) * fy, fx * fy
    for i in range(side):
        upper, lower, out = gray[row + i], gray[row + i + 1], values[i * side : (i + 1) * side]
        for j in range(side):
            c = column + j
            out[j] = first * upper[c] + second * upper[c + 1] + third * lower[c] + fourth * lower[c + 1]


@inlined(fastmath=True)
def _sums(values: FloatArray, template: FloatArray, pull_x: FloatArray, pull_y: FloatArray) -> Any:
    """Sums of the values, their squares, and their products with the template and both pulls."""
    total, square, along, along_x, along_y = (np.float32(0), np.float32(0), np.float32(0), np.float32(0), np.float32(0))
    for k in range(len(values)):
        total += values[k]
        square += values[k] * values[k]
        along += template[k] * values[k]
        along_x += pull_x[k] * values[k]
        along_y += pull_y[k] * values[k]
    return total, square, along, along_x, along_y
