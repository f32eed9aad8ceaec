"""Square patches of the reference and the measurement of their displacements in a frame.

Inverse compositional alignment (Baker and Matthews 2004, section 3.2.1) with one displacement per patch instead of one
parameter vector for all. All derivatives are taken of the template, so the only work per frame is the sampling of the
current frame and a few inner products. Brightness and contrast of each patch drop out, because the displacement filters
are orthogonal to a constant and to the template.

The gradient is correlated with a smoother version of itself (an instrumental variable), which is equivalent to
smoothing both images but costs nothing per frame. The finest wavelengths are aliased by sampling and distorted by
interpolation. With them, displacements would be biased by 0.015 px towards or away from whole pixels.
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

_BAND_ROWS = 128  # image rows processed together
_SMOOTHING_PX, _BLUR_REACH = 2.0, 8  # of the instrument; equivalent to smoothing both images by 1.4 px
_ORIGIN_OFFSET_PX = 256  # larger than the distance of any sample from its patch centre
_NEARLY_TRANSLATED_PX = 0.12  # with less deformation at its edge, a patch is sampled as if only translated
# The residuals of a patch are correlated between pixels (interpolation, aliasing), and the smooth filters respond to
# just these. Without this factor, the displacements on the synthetic scenes have a chi-square per degree of freedom of
# 2.2 to 2.5 at any noise level (0 to 4 grey levels).
_NOISE_CORRELATION = 2.3
_MIN_PATCHES_PER_THREAD = 100
_QUANTISATION = 1.0 / 12  # variance of rounding to whole grey levels


@dataclass(frozen=True, eq=False)
class Patches:
    """N patches of s x s px, s = 2 radius + 1.

    Attributes:
        centres: (N, 2) int64, px.
        radius: half the side, px.
        template: (N, s, s) float32, zero mean.
        power: (N,) sum of template^2.
        filters: (2, N, s, s) float32 displacement filters, orthogonal to a constant and to the template; the inner
            product of a filter and the image is the displacement along x or y, px.
        precision: (N, 2, 2) inverse Gram matrix of the filters: the information matrix at unit noise, 1/px^2.
        affine_sensitivity: (N, 2, 4) apparent displacement of an image deformed by u(x) = M x about the centre, per
            unit of mxx, mxy, myx and myy, px.
    """

    centres: IdArray
    radius: int
    template: FloatArray
    power: FloatArray
    filters: FloatArray
    precision: FloatArray
    affine_sensitivity: FloatArray

    def __len__(self) -> int:
        return len(self.centres)

    def __getitem__(self, keep: BoolArray) -> Patches:
        return Patches(self.centres[keep], self.radius, self.template[keep], self.power[keep],
                       np.compress(keep, self.filters, axis=1), self.precision[keep], self.affine_sensitivity[keep])


@dataclass(frozen=True, eq=False)
class Measurements:
    """Measurements of N chosen patches in one image.

    Attributes:
        chosen: (N,) int64 indices into the patches.
        displacement: (N, 2), px, of the image relative to the template, reference side.
        correlation: (N,) normalized cross-correlation with the template; 0 where the patch is outside the image.
        information: (N, 2, 2) inverse covariance of the displacement, 1/px^2.
    """

    chosen: IdArray
    displacement: FloatArray
    correlation: FloatArray
    information: FloatArray


def cut_patches(gray: Gray, centres: IdArray, radius: int) -> Patches:
    """Cuts patches of an image and computes their displacement filters.

    Patches that do not determine both components of a displacement are left out. The image is processed in bands of
    rows, so that no large intermediate array is needed.

    Args:
        gray: (h, w) uint8.
        centres: (N, 2) int64, px, as far from the border as those of `spread.choose`.
        radius: half the side of a patch, px.
    """
    n, side = len(centres), 2 * radius + 1
    patches = Patches(centres, radius, np.empty((n, side, side), np.float32), np.empty(n),
                      np.empty((2, n, side, side), np.float32), np.empty((n, 2, 2)), np.empty((n, 2, 4)))
    usable, band = np.zeros(n, bool), centres[:, 1] // _BAND_ROWS
    for number in np.unique(band):
        _fill(patches, usable, np.flatnonzero(band == number), gray)
    return patches if usable.all() else patches[usable]


def _fill(patches: Patches, usable: BoolArray, which: IdArray, gray: Gray) -> None:
    """Fills in the patches `which`, all of one band of rows, and whether each is usable."""
    radius = patches.radius
    rows, centres = _band(gray, patches.centres[which], radius + 2 + _BLUR_REACH)
    template = _windows(rows, centres, radius)
    template -= template.mean(axis=(1, 2), keepdims=True)
    power = np.maximum(np.einsum("nij,nij->n", template, template), 1e-9)
    gradient = _gradient(rows, centres, radius)
    instrument = _gradient(cv2.GaussianBlur(rows.astype(np.float32), (0, 0), _SMOOTHING_PX), centres, radius)
    gradient, instrument = (_orthogonal_to_brightness(image, template, power) for image in (gradient, instrument))
    response = np.einsum("anij,bnij->nab", instrument, gradient)
    good = _is_regular(response, 1e-6) & _is_regular(np.einsum("anij,bnij->nab", instrument, instrument), 1e-12)
    filters = -np.einsum("nab,bnij->anij", np.linalg.inv(response[good]), instrument[:, good])
    along = np.arange(-radius, radius + 1.0)
    moments = np.stack([gradient[:, good] * along, gradient[:, good] * along[:, None]], axis=1)  # with x and with y
    usable[which] = good
    which = which[good]
    patches.template[which], patches.power[which], patches.filters[:, which] = template[good], power[good], filters
    patches.precision[which] = np.linalg.inv(np.einsum("anij,bnij->nab", filters, filters))
    patches.affine_sensitivity[which] = -np.einsum("anij,dmnij->nadm", filters, moments).reshape(-1, 2, 4)


def _is_regular(matrices: FloatArray, least: float) -> BoolArray:
    """(N,) bool: which of (N, 2, 2) have a determinant of more than this share of the product of their diagonal."""
    return np.asarray(np.abs(np.linalg.det(matrices)) > least * np.abs(matrices[:, 0, 0] * matrices[:, 1, 1]))


def _band(gray: Gray, centres: IdArray, reach: int) -> tuple[Gray, IdArray]:
    """The image rows within `reach` of any centre, and the centres relative to them."""
    top = max(0, int(centres[:, 1].min()) - reach)
    return gray[top : int(centres[:, 1].max()) + reach + 1], centres - np.array([0, top])


def _orthogonal_to_brightness(images: FloatArray, template: FloatArray, power: FloatArray) -> FloatArray:
    """Images (2, N, s, s) projected to be orthogonal to a constant and to the template."""
    centred = images - images.mean(axis=(2, 3), keepdims=True)
    along = np.einsum("dnij,nij->dn", centred, template) / power
    return np.asarray(centred - along[:, :, None, None] * template)


def _windows(image: Image, centres: IdArray, radius: int) -> FloatArray:
    """Windows (N, s, s) float64, s = 2 radius + 1."""
    span = np.arange(-radius, radius + 1)
    rows = centres[:, 1, None, None] + span[None, :, None]
    columns = centres[:, 0, None, None] + span[None, None, :]
    return np.asarray(image[rows, columns], np.float64)


def _gradient(image: Image, centres: IdArray, radius: int) -> FloatArray:
    """Windows (2, N, s, s) of the derivatives along x and along y."""
    wide, inner = _windows(image, centres, radius + 2), slice(2, -2)
    return np.stack([_derivative(wide, 2)[:, inner, :], _derivative(wide, 1)[:, :, inner]])


def _derivative(wide: FloatArray, axis: int) -> FloatArray:
    """Fourth-order central difference, exact for cubics; `axis` gets two px shorter at either end."""
    n = wide.shape[axis]
    at = [np.take(wide, np.arange(k, n - 4 + k), axis=axis) for k in range(5)]
    return np.asarray((at[0] - 8 * at[1] + 8 * at[3] - at[4]) / 12)


def measure_patches(patches: Patches, chosen: IdArray, gray: Gray, cur_H_ref: Homography,
            at_px: FloatArray | None = None) -> Measurements:
    """Measures the displacements of patches from their positions under a homography.

    Args:
        patches: patches of the reference.
        chosen: (N,) int64, indices of the patches to measure.
        gray: (h, w) uint8, the current frame.
        cur_H_ref: homography from reference to current pixels.
        at_px: (N, 2), positions of the patches in the frame, px, if not those under `cur_H_ref`, which then gives the
            local affine deformation only.
    """
    n, chosen = len(chosen), np.ascontiguousarray(chosen)
    at_px = apply(cur_H_ref, patches.centres[chosen].astype(np.float64)) if at_px is None else at_px
    measured = Measurements(chosen, np.zeros((n, 2)), np.zeros(n), np.zeros((n, 2, 2)))

    def part(first: int, last: int) -> None:
        these = slice(first, last)
        _measure(gray, cur_H_ref, at_px[these], chosen[these], patches.centres, patches.radius, patches.template,
                 patches.power, patches.filters, patches.precision, patches.affine_sensitivity,
                 measured.displacement[these], measured.correlation[these], measured.information[these])

    in_parallel(part, n, _MIN_PATCHES_PER_THREAD)
    return measured


# The helpers below are inlined. Linked separately, a freshly compiled kernel and one from numba's cache would round
# differently, and the node and the command line would give different homographies.
@kernel((read(U8, 2), read(F64, 2), read(F64, 2), read(I64, 1), read(I64, 2), I64, read(F32, 3), read(F64, 1),
         read(F32, 4), read(F64, 3), read(F64, 3), filled(F64, 2), filled(F64, 1), filled(F64, 3)), fastmath=True)
def _measure(gray: Gray, H: Homography, at_px: FloatArray, chosen: IdArray, centres: IdArray, radius: int,
             template: FloatArray, power: FloatArray, filters: FloatArray, precision: FloatArray,
             affine_sensitivity: FloatArray, displacement: FloatArray, correlation: FloatArray,
             information: FloatArray) -> None:
    """Fills the last three arrays; they stay 0 for a patch that is not completely inside the image, or flat there."""
    height, width = gray.shape
    count = (2 * radius + 1) ** 2
    for i in range(len(chosen)):
        p = chosen[i]
        cx, cy = float(centres[p, 0]), float(centres[p, 1])
        w = H[2, 0] * cx + H[2, 1] * cy + H[2, 2]
        if w <= 0:
            continue
        px, py = at_px[i, 0], at_px[i, 1]
        # Jacobian of the homography at the centre; higher orders are below 0.001 px over a patch
        hx, hy = (H[0, 0] * cx + H[0, 1] * cy + H[0, 2]) / w, (H[1, 0] * cx + H[1, 1] * cy + H[1, 2]) / w
        xx, xy = (H[0, 0] - hx * H[2, 0]) / w, (H[0, 1] - hx * H[2, 1]) / w
        yx, yy = (H[1, 0] - hy * H[2, 0]) / w, (H[1, 1] - hy * H[2, 1]) / w
        reach_x, reach_y = radius * (abs(xx) + abs(xy)), radius * (abs(yx) + abs(yy))
        if not (px - reach_x >= 1 and py - reach_y >= 1 and px + reach_x < width - 3 and py + reach_y < height - 3):
            continue
        det = xx * yy - xy * yx
        deformation = np.array([1 - yy / det, xy / det, yx / det, 1 - xx / det])  # I - A^-1, A the Jacobian
        nearly_translated = np.max(np.abs(deformation)) * radius < _NEARLY_TRANSLATED_PX
        values = np.empty(count, np.float32)
        if nearly_translated:
            _sample_translated(gray, px, py, radius, values)
        else:
            _sample(gray, px, py, xx, xy, yx, yy, radius, values)
        total, square, along, filter_x, filter_y = _sums(values, template[p].ravel(), filters[0, p].ravel(),
                                                     filters[1, p].ravel())
        variance = square - total * total / count
        if variance <= 0 or along <= 0:
            continue
        gain = along / power[p]
        noise = _NOISE_CORRELATION * (max(variance - along * gain, 0.0) / (count - 2) + _QUANTISATION)
        displacement[i, 0], displacement[i, 1] = filter_x / gain, filter_y / gain
        if nearly_translated:
            for a in range(2):
                for m in range(4):
                    displacement[i, a] -= affine_sensitivity[p, a, m] * deformation[m]
        correlation[i] = along / np.sqrt(variance * power[p])
        for a in range(2):
            for b in range(2):
                information[i, a, b] = precision[p, a, b] * gain * gain / noise


@inlined(fastmath=True)
def _sample(gray: Gray, px: float, py: float, xx: float, xy: float, yx: float, yy: float, radius: int,
            values: FloatArray) -> None:
    """Bilinear samples on the grid of a patch around (px, py), mapped by the affine part.

    Positions are computed first and values in a second loop: only then both loops are vectorized.
    """
    count = len(values)
    offset, fx, fy = np.empty(count, np.int32), np.empty(count, np.float32), np.empty(count, np.float32)
    width, base_x, base_y = gray.shape[1], int(px) - _ORIGIN_OFFSET_PX, int(py) - _ORIGIN_OFFSET_PX
    start_x, start_y = np.float32(px - base_x), np.float32(py - base_y)
    step_xx, step_xy, step_yx, step_yy = np.float32(xx), np.float32(xy), np.float32(yx), np.float32(yy)
    k = 0
    for row in range(-radius, radius + 1):
        for column in range(-radius, radius + 1):
            x = start_x + step_xx * np.float32(column) + step_xy * np.float32(row)
            y = start_y + step_yx * np.float32(column) + step_yy * np.float32(row)
            whole_x, whole_y = np.int32(x), np.int32(y)  # positive thanks to _AHEAD, so this is the floor
            offset[k] = whole_y * width + whole_x
            fx[k], fy[k] = x - np.float32(whole_x), y - np.float32(whole_y)
            k += 1
    pixels, origin = gray.ravel(), base_y * width + base_x
    for k in range(count):
        at = origin + offset[k]
        first, second = np.float32(pixels[at]), np.float32(pixels[at + 1])
        third, fourth = np.float32(pixels[at + width]), np.float32(pixels[at + width + 1])
        top, bottom = first + fx[k] * (second - first), third + fx[k] * (fourth - third)
        values[k] = top + fy[k] * (bottom - top)


@inlined(fastmath=True)
def _sample_translated(gray: Gray, px: float, py: float, radius: int, values: FloatArray) -> None:
    """Bilinear samples of a patch around (px, py) that is only translated: constant weights, contiguous loads."""
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
def _sums(values: FloatArray, template: FloatArray, filter_x: FloatArray, filter_y: FloatArray) -> Any:
    """Sums of the values, of their squares, and of their products with the template and both displacement filters."""
    total, square, along, filtered_x, filtered_y = (np.float32(0), np.float32(0), np.float32(0), np.float32(0),
                                                    np.float32(0))
    for k in range(len(values)):
        total += values[k]
        square += values[k] * values[k]
        along += template[k] * values[k]
        filtered_x += filter_x[k] * values[k]
        filtered_y += filter_y[k] * values[k]
    return total, square, along, filtered_x, filtered_y
