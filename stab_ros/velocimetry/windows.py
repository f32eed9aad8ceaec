"""Windows of the water, and the comparison of them with a later frame.

The terms of inverse compositional alignment (Baker and Matthews 2004, section 3.2.1), of each window by itself. The
displacement inside a window is a polynomial of second order, since a window that moves in a river is sheared, and its
middle moves faster than its mean: `u(x, y) = sum_m c_m f_m(x / r, y / r)` with `f = (1, x, y, x^2, x y, y^2)` and `r`
half the side, for both components. Brightness and contrast drop out. The gradient is correlated with a smoother version
of itself, as in `methods.patches`: it takes away the bias of aliasing and interpolation.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from stab_ros.core.kernels import F32, F64, I64, U8, filled, inlined, kernel, read
from stab_ros.core.threads import in_parallel
from stab_ros.core.types import FloatArray, Gray, IdArray

_SMOOTHING_PX, _BLUR_REACH = 1.5, 5  # of the instrument
_MARGIN = _BLUR_REACH + 2  # and of the gradient
_LEAST_PER_THREAD = 50
_BLOCK = 3  # side of the blocks whose means tell the noise, px
_CHUNK = 50  # windows that are cut together: their intermediate arrays stay in the processor's cache
TERMS = 6  # of the polynomial of one component
PARAMETERS = 2 * TERMS


@dataclass(frozen=True, eq=False)
class Windows:
    """N windows of s x s px, s = 2 radius + 1; the 12 parameters are the coefficients of u, then those of v, px.

    Attributes:
        radius: half the side, px.
        template: (N, s, s) float32, zero mean, grey levels.
        levels: (3, N, s // 3, s // 3) float32, means over blocks of 3x3 px of the template, and of its second
            differences along x and y.
        blur: (N, 2), how much of its second differences along x and y interpolation has added to the template.
        power: (N,) sum of template^2.
        gradient: (2, N, s, s) float32, smoothed derivatives along x and y.
        constant: (N, 12), mean of each steepest descent image, to be projected out.
        likeness: (N, 12), share of the template in each, to be projected out.
        blurred: (N, 12, 2), projected products of the template's second differences along x and y.
        response: (N, 12, 12), change of the projected products by the parameters.
        gram: (N, 12, 12), covariance of the products at unit noise.
    """

    radius: int
    template: FloatArray
    levels: FloatArray
    blur: FloatArray
    power: FloatArray
    gradient: FloatArray
    constant: FloatArray
    likeness: FloatArray
    blurred: FloatArray
    response: FloatArray
    gram: FloatArray

    def __len__(self) -> int:
        return len(self.template)

    def put(self, which: IdArray, other: Windows) -> None:
        """Replaces the windows `which`, (n,), by the n ones of `other`."""
        self.gradient[:, which], self.levels[:, which] = other.gradient, other.levels
        for name in ("template", "blur", "power", "constant", "likeness", "blurred", "response", "gram"):
            getattr(self, name)[which] = getattr(other, name)


@dataclass(frozen=True, eq=False)
class Seen:
    """n windows compared with a frame.

    Attributes:
        products: (n, 12), projected products of the image with the steepest descent images, at unit gain.
        gain: (n,) contrast relative to the template; 0 where the window is not completely inside the image, or flat.
        correlation: (n,) with the template.
        noise: (n,) what the template, as interpolation blurs it, does not explain, at unit gain: power at long
            wavelengths, as the variance of the white noise that has it there, grey levels^2.
    """

    products: FloatArray
    gain: FloatArray
    correlation: FloatArray
    noise: FloatArray


def cut_windows(gray: Gray, centres_px: FloatArray, radius: int) -> Windows:
    """Cuts windows.

    Args:
        gray: (h, w) uint8.
        centres_px: (N, 2), whole or fractions of pixels; beyond the border of the image it is continued.
        radius: half the side, px.
    """
    n = len(centres_px)
    windows = _empty(n, radius)

    def chunks(first: int, last: int) -> None:
        for start in range(first * _CHUNK, min(last * _CHUNK, n), _CHUNK):
            some = np.arange(start, min(start + _CHUNK, n))
            windows.put(some, _cut(gray, centres_px[some], radius))

    in_parallel(chunks, -(-n // _CHUNK), least=1)
    return windows


def _empty(n: int, radius: int) -> Windows:
    """Windows to be filled."""
    side, blocks, many = 2 * radius + 1, (2 * radius + 1) // _BLOCK, PARAMETERS
    return Windows(radius, np.empty((n, side, side), np.float32), np.empty((3, n, blocks, blocks), np.float32),
                   np.empty((n, 2)), np.empty(n), np.empty((2, n, side, side), np.float32), np.empty((n, many)),
                   np.empty((n, many)), np.empty((n, many, 2)), np.empty((n, many, many)), np.empty((n, many, many)))


def _cut(gray: Gray, centres_px: FloatArray, radius: int) -> Windows:
    """As `cut_windows`, of few windows at a time."""
    wide = _sampled(gray, centres_px, radius + _MARGIN)
    inner = slice(_MARGIN, -_MARGIN)
    template = wide[:, inner, inner] - wide[:, inner, inner].mean(axis=(1, 2), keepdims=True)
    exact, gradient = _gradient(wide, inner), _gradient(_smoothed(wide), inner)
    power = np.maximum(np.einsum("nij,nij->n", template, template).astype(float), 1e-9)
    images, flat = _steepest_descent(gradient, radius), template.reshape(len(template), (2 * radius + 1) ** 2)
    constant = images.mean(axis=2)
    likeness = np.einsum("npk,nk->np", images, flat) / power[:, None]
    images -= constant[:, :, None] + likeness[:, :, None].astype(np.float32) * flat[:, None]
    response = images @ _steepest_descent(exact, radius).transpose(0, 2, 1)
    bends = _bends(wide, inner)
    blurred = images @ bends.reshape(2, len(bends[0]), -1).transpose(1, 2, 0)
    return Windows(radius, np.ascontiguousarray(template), _levels(np.stack([template, *bends])), _blur(centres_px % 1),
                   power, np.ascontiguousarray(gradient), constant.astype(float), likeness.astype(float),
                   blurred.astype(float), response.astype(float),
                   (images @ images.transpose(0, 2, 1)).astype(float))


def see(windows: Windows, chosen: IdArray, gray: Gray, places_px: FloatArray) -> Seen:
    """Compares windows with a frame.

    Args:
        windows: of an earlier frame.
        chosen: (n,) which of them.
        gray: (h, w) uint8.
        places_px: (n, 2, 6), where their points are assumed in the frame: coefficients of the polynomials of x and y.
    """
    n = len(chosen)
    seen = Seen(np.zeros((n, PARAMETERS)), np.zeros(n), np.zeros(n), np.zeros(n))

    def part(first: int, last: int) -> None:
        s = slice(first, last)
        _see(gray, places_px[s], chosen[s], windows.radius, windows.template, windows.power, windows.gradient,
             windows.levels, windows.blur, windows.constant, windows.likeness, windows.blurred, seen.products[s],
             seen.gain[s], seen.correlation[s], seen.noise[s])

    in_parallel(part, n, _LEAST_PER_THREAD)
    return seen


def _sampled(gray: Gray, centres_px: FloatArray, radius: int) -> FloatArray:
    """Windows (N, s, s) float32, bilinear."""
    whole = np.floor(centres_px).astype(np.int64)
    fx, fy = ((centres_px - whole).T[..., None, None]).astype(np.float32)
    span = np.arange(-radius, radius + 2)
    rows = np.clip(whole[:, 1, None] + span, 0, gray.shape[0] - 1)
    columns = np.clip(whole[:, 0, None] + span, 0, gray.shape[1] - 1)
    raw = gray[rows[:, :, None], columns[:, None, :]].astype(np.float32)
    along = raw[:, :, :-1] + fx * (raw[:, :, 1:] - raw[:, :, :-1])
    return np.asarray(along[:, :-1] + fy * (along[:, 1:] - along[:, :-1]))


def _smoothed(wide: FloatArray) -> FloatArray:
    """Windows (N, s, s), each smoothed; rows at its top and bottom mix with those of its neighbours."""
    stacked = wide.reshape(-1, wide.shape[1])
    return np.asarray(cv2.GaussianBlur(stacked, (0, 0), _SMOOTHING_PX).reshape(wide.shape))


def _gradient(wide: FloatArray, inner: slice) -> FloatArray:
    """(2, N, s, s) derivatives along x and y by fourth-order central differences."""
    return np.stack([_derivative(wide, 2)[:, inner, inner], _derivative(wide, 1)[:, inner, inner]])


def _derivative(image: FloatArray, axis: int) -> FloatArray:
    one, two = ([np.roll(image, -k, axis) for k in (step, -step)] for step in (1, 2))
    return np.asarray((8 * (one[0] - one[1]) - (two[0] - two[1])) / 12)


def _bends(wide: FloatArray, inner: slice) -> FloatArray:
    """(2, N, s, s) second differences along x and y."""
    return np.stack([(np.roll(wide, 1, axis) + np.roll(wide, -1, axis) - 2 * wide)[:, inner, inner]
                     for axis in (2, 1)])


def _blur(fraction: FloatArray) -> FloatArray:
    """How much of the second difference linear interpolation adds at a fraction of a pixel."""
    return np.asarray(fraction * (1 - fraction) / 2)


def _levels(values: FloatArray) -> FloatArray:
    """Means (K, N, b, b) of values (K, N, s, s) over blocks; rows and columns that fill no block are left out."""
    blocks = values.shape[2] // _BLOCK
    whole = values[:, :, : blocks * _BLOCK, : blocks * _BLOCK]
    return np.asarray(whole.reshape(*whole.shape[:2], blocks, _BLOCK, blocks, _BLOCK).mean(axis=(3, 5)))


def _steepest_descent(gradient: FloatArray, radius: int) -> FloatArray:
    """(N, 12, s * s) float32: change of the template by each parameter."""
    y, x = np.mgrid[-radius : radius + 1, -radius : radius + 1].astype(np.float32) / np.float32(radius)
    terms = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y])
    images = gradient.transpose(1, 0, 2, 3)[:, :, None] * terms
    return np.asarray(images.reshape(len(images), PARAMETERS, (2 * radius + 1) ** 2))


# The helpers are inlined, so that fresh and cached code round alike (see `methods.patches`).
@kernel((read(U8, 2), read(F64, 3), read(I64, 1), I64, read(F32, 3), read(F64, 1), read(F32, 4), read(F32, 4),
         read(F64, 2), read(F64, 2), read(F64, 2), read(F64, 3), filled(F64, 2), filled(F64, 1), filled(F64, 1),
         filled(F64, 1)), fastmath=True)
def _see(gray: Gray, places: FloatArray, chosen: IdArray, radius: int, template: FloatArray, power: FloatArray,
         gradient: FloatArray, blocks: FloatArray, blur: FloatArray, constant: FloatArray, likeness: FloatArray,
         blurred: FloatArray, products: FloatArray, gain: FloatArray, correlation: FloatArray,
         noise: FloatArray) -> None:
    """Fills the last four arrays; they stay 0 for a window that is not completely inside the image, or flat."""
    height, width = gray.shape
    side = 2 * radius + 1
    count = side * side
    values, raw = np.empty((side, side), np.float32), np.empty(12)
    expected, left = np.empty(blocks.shape[2:]), np.empty(blocks.shape[2:])
    for i in range(len(chosen)):
        p, at = chosen[i], places[i]
        reach_x, reach_y = np.sum(np.abs(at[0, 1:])), np.sum(np.abs(at[1, 1:]))
        if not (at[0, 0] - reach_x >= 0 and at[1, 0] - reach_y >= 0 and at[0, 0] + reach_x < width - 2
                and at[1, 0] + reach_y < height - 2):
            continue
        more_x, more_y = _sample(gray, at, radius, values)
        more_x, more_y = more_x - blur[p, 0], more_y - blur[p, 1]
        _project(values, gradient[0, p], gradient[1, p], radius, raw)
        total, square, along = 0.0, 0.0, 0.0
        for y in range(side):
            s, s2, st = np.float32(0), np.float32(0), np.float32(0)
            for x in range(side):
                s += values[y, x]
                s2 += values[y, x] * values[y, x]
                st += values[y, x] * template[p, y, x]
            total, square, along = total + float(s), square + float(s2), along + float(st)
        variance = square - total * total / count
        if variance <= 0 or along <= 0:
            continue
        for y in range(len(expected)):
            for x in range(len(expected)):
                expected[y, x] = blocks[0, p, y, x] + more_x * blocks[1, p, y, x] + more_y * blocks[2, p, y, x]
        contrast, rest = _fitted(values, expected, left)
        if contrast <= 0:
            continue
        gain[i], noise[i] = contrast, rest / contrast**2
        correlation[i] = along / np.sqrt(variance * power[p])
        for k in range(12):
            products[i, k] = ((raw[k] - constant[p, k] * total - likeness[p, k] * along) / gain[i]
                              - more_x * blurred[p, k, 0] - more_y * blurred[p, k, 1])


@inlined(fastmath=True)
def _fitted(values: FloatArray, expected: FloatArray, left: FloatArray) -> tuple[float, float]:
    """The contrast relative to what is expected, and the noise beside it.

    The noise is the variance of white noise that has the power of the residuals at the wavelengths of the filters. By
    means over blocks of 3x3 px: at short wavelengths interpolation takes noise away, to which the smooth filters do not
    respond, and there the noise of the template makes the contrast seem lower than it is, which would leave a share of
    the texture among the residuals. What has changed in the texture of the water is correlated between blocks, which
    adds to its power. The 12 parameters, contrast and mean took 14 times the result out of the residuals.

    Args:
        values: (s, s).
        expected: (blocks, blocks), what is expected of the means.
        left: (blocks, blocks), is overwritten.
    """
    blocks, count, total, mean, square, along = len(left), left.size, 0.0, 0.0, 1e-9, 0.0
    for i in range(blocks):
        for j in range(blocks):
            level = np.float32(0)
            for y in range(3 * i, 3 * i + 3):
                for x in range(3 * j, 3 * j + 3):
                    level += values[y, x]
            left[i, j] = level / 9
            total, mean = total + left[i, j] / count, mean + expected[i, j] / count
    for i in range(blocks):
        for j in range(blocks):
            square += (expected[i, j] - mean) ** 2
            along += (expected[i, j] - mean) * (left[i, j] - total)
    gain, power, alike = along / square, 0.0, 0.0
    for i in range(blocks):
        for j in range(blocks):
            left[i, j] = 3 * (left[i, j] - total - gain * (expected[i, j] - mean))
            power += left[i, j] * left[i, j]
            if i > 0:
                alike += left[i, j] * left[i - 1, j]
            if j > 0:
                alike += left[i, j] * left[i, j - 1]
    neighbours = 2 * blocks * (blocks - 1)
    colour = 1 + 2 * max(alike / neighbours * count / max(power, 1e-9), 0.0)
    return gain, power * colour / max(count - 14 * colour, 1) + 1 / 12


@inlined(fastmath=True)
def _sample(gray: Gray, at: FloatArray, radius: int, values: FloatArray) -> tuple[float, float]:
    """Bilinear samples on the grid of a window at the places `at`, (2, 6), and how they are blurred.

    At a fraction f of a pixel, linear interpolation adds f (1 - f) / 2 of the second difference to the image. The
    means of that factor along x and y are returned.
    """
    width, blur_x, blur_y = gray.shape[1], 0.0, 0.0
    pixels = gray.ravel()
    for i in range(2 * radius + 1):
        y = (i - radius) / radius
        x0, x1 = at[0, 0] + at[0, 2] * y + at[0, 5] * y * y, at[0, 1] + at[0, 4] * y
        y0, y1 = at[1, 0] + at[1, 2] * y + at[1, 5] * y * y, at[1, 1] + at[1, 4] * y
        for j in range(2 * radius + 1):
            x = (j - radius) / radius
            px, py = x0 + x * (x1 + x * at[0, 3]), y0 + x * (y1 + x * at[1, 3])
            whole_x, whole_y = int(px), int(py)
            fx, fy = np.float32(px - whole_x), np.float32(py - whole_y)
            k = whole_y * width + whole_x
            first, second = np.float32(pixels[k]), np.float32(pixels[k + 1])
            third, fourth = np.float32(pixels[k + width]), np.float32(pixels[k + width + 1])
            upper, lower = first + fx * (second - first), third + fx * (fourth - third)
            values[i, j] = upper + fy * (lower - upper)
            blur_x, blur_y = blur_x + float(fx * (1 - fx)), blur_y + float(fy * (1 - fy))
    count = 2 * (2 * radius + 1) ** 2
    return blur_x / count, blur_y / count


@inlined(fastmath=True)
def _project(values: FloatArray, gradient_x: FloatArray, gradient_y: FloatArray, radius: int, raw: FloatArray) -> None:
    """Fills `raw`, (12,), with the products of the values and the steepest descent images."""
    raw[:] = 0.0
    for i in range(2 * radius + 1):
        sx, sxx, sxxx, sy, syx, syxx = (np.float32(0), np.float32(0), np.float32(0), np.float32(0), np.float32(0),
                                        np.float32(0))
        for j in range(2 * radius + 1):
            at = np.float32(j - radius)
            vx, vy = values[i, j] * gradient_x[i, j], values[i, j] * gradient_y[i, j]
            sx += vx
            sxx += vx * at
            sxxx += vx * at * at
            sy += vy
            syx += vy * at
            syxx += vy * at * at
        y, r = (i - radius) / radius, radius
        raw[0] += sx
        raw[1] += sxx / r
        raw[2] += sx * y
        raw[3] += sxxx / (r * r)
        raw[4] += sxx / r * y
        raw[5] += sx * y * y
        raw[6] += sy
        raw[7] += syx / r
        raw[8] += sy * y
        raw[9] += syxx / (r * r)
        raw[10] += syx / r * y
        raw[11] += sy * y * y
