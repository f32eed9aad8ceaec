"""Kernels of the renderer of reaches: rays onto relief and water, and what is seen there.

A ray meets the relief exactly: it walks from cell to cell (Amanatides and Woo 1987), past blocks of cells that lie
lower, and within a cell the surface is bilinear, so that the ray meets it at a root of a quadratic.

A pixel is the mean of 2 rays across by 2 to 6 along its column, the more the flatter they fall, and each takes the
detail of the ground from a texture that is averaged to the distance between the rays (Williams 1983).
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from stab_ros.core.kernels import lazy_kernel
from stab_ros.core.types import Float32Array, FloatArray
from stab_ros.synthetic.reach import BLOCK, CELL_M
from stab_ros.synthetic.textures import TILE, Texture

FloatImage: TypeAlias = NDArray[np.float32]

FAR_M = 2500.0  # depth from which on the haze hides all
_HAZE_M = 800.0  # distance after which 1 - 1 / e of the light is the haze's
_FINE_M, _MIDDLE_M = 0.021, 0.173  # texels of the ground's detail
_RIPPLE_M, _WAVE_M = 0.045, 0.131  # texels of the water's
_FINE_LOG, _MIDDLE_LOG, _RIPPLE_LOG, _WAVE_LOG = (math.log2(m) for m in (_FINE_M, _MIDDLE_M, _RIPPLE_M, _WAVE_M))
_MOST_RAYS, _SKY_UP = 6, 0.03  # along a pixel's column; sine of the angle above which there is hardly any ground
_BOARD_RAYS, _GOLDEN = 610, 377 / 610
_LEVELS = 10  # of the averaged textures: from 1024 texels down to 2
_QUICK: dict[str, Any] = {"error_model": "numpy", "fastmath": {"contract", "arcp", "nsz"}}


class Sight(NamedTuple):
    """A camera at one instant, over a reach with its water.

    Attributes:
        position: (3,), m.
        map_R_cam: (3, 3).
        pixel_rad: angle of a pixel at the image's centre.
        wse_m: water surface elevation.
        top_m: the highest point of the ground.
    """

    position: FloatArray
    map_R_cam: FloatArray
    pixel_rad: float
    wse_m: float
    top_m: float


class Land(NamedTuple):
    """Arrays of `Reach`, and the detail.

    Attributes:
        heights: as `Reach.height_m`.
        tops: as `Reach.tops_m`.
        cover: as `Reach.cover`.
        detail: textures from `averaged`.
    """

    heights: Float32Array
    tops: Float32Array
    cover: Float32Array
    detail: Float32Array


class Water(NamedTuple):
    """The water at one instant.

    Attributes:
        color: (channels,) float32, of the deep water.
        waves: a texture from `averaged`.
        lives: (2, 4) age, s, weight and offset x, y, m, of two generations of ripples.
        stream: (4,) half width, m, amplitude of the bend, m, its wave number, rad/m, and speed in mid-stream, m/s.
    """

    color: Float32Array
    waves: Float32Array
    lives: FloatArray
    stream: FloatArray


def averaged(texture: Texture) -> Float32Array:
    """A texture and its averages over 2 x 2, 4 x 4, ... texels, one after another in one array."""
    levels = [texture]
    for _ in range(_LEVELS - 1):
        n = len(levels[-1]) // 2
        levels.append(levels[-1].reshape(n, 2, n, 2).mean(axis=(1, 3)))
    return np.concatenate([level.ravel() for level in levels]).astype(np.float32)


@lazy_kernel(inline="always", **_QUICK)
def _texel_mean(pyramid: Float32Array, level: int, x: float, y: float) -> float:
    """The average of `level` at (x, y), texels of the finest, linear between its texels."""
    size = TILE >> level
    start = (TILE * TILE - size * size) * 4 // 3  # texels of the finer levels
    scale = 1.0 / (1 << level)
    u, v = (x + 0.5) * scale - 0.5, (y + 0.5) * scale - 0.5
    left, top = int(np.floor(u)), int(np.floor(v))
    fx, fy = u - left, v - top
    j0, i0 = left & (size - 1), top & (size - 1)
    j1, i1 = (j0 + 1) & (size - 1), (i0 + 1) & (size - 1)
    upper = pyramid[start + i0 * size + j0] * (1 - fx) + pyramid[start + i0 * size + j1] * fx
    lower = pyramid[start + i1 * size + j0] * (1 - fx) + pyramid[start + i1 * size + j1] * fx
    return float(upper * (1 - fy) + lower * fy)


@lazy_kernel(**_QUICK)
def _detail(pyramid: Float32Array, level: float, x: float, y: float) -> float:
    """A texture at (x, y), texels, averaged over about 2^level of them."""
    level = min(max(level, 0.0), _LEVELS - 1.001)
    k = int(level)
    value = _texel_mean(pyramid, k, x, y)
    share = level - k
    if share > 0:
        value += share * (_texel_mean(pyramid, k + 1, x, y) - value)
    return float(value)


@lazy_kernel(**_QUICK)
def _depth(heights: Float32Array, tops: Float32Array, start: FloatArray, top_m: float, wse_m: float,
           dx: float, dy: float, dz: float) -> tuple[float, bool]:
    """Depth along a ray from `start` (3,) where it meets ground or water, and whether it is water; FAR_M beyond."""
    blocks, x0, y0, z0 = tops.shape[0], start[0], start[1], start[2]
    end, water, t = FAR_M, False, 0.0
    if dz < 0 and (wse_m - z0) / dz < FAR_M:
        end, water = (wse_m - z0) / dz, True
    if z0 > top_m:
        if dz >= 0:
            return FAR_M, False
        t = (top_m - z0) / dz
    px, py, sx, sy = x0 / CELL_M, y0 / CELL_M, dx / CELL_M, dy / CELL_M  # in cells
    qx, qy = 1 / sx if sx != 0 else 1e30, 1 / sy if sy != 0 else 1e30
    forward_x, forward_y = int(sx > 0), int(sy > 0)
    j, i = int(np.floor(px + t * sx)), int(np.floor(py + t * sy))
    while t < end:
        block_j, block_i = j // BLOCK, i // BLOCK
        out_x = ((block_j + forward_x) * BLOCK - px) * qx if sx != 0 else 1e30
        out_y = ((block_i + forward_y) * BLOCK - py) * qy if sy != 0 else 1e30
        highest = tops[block_i & (blocks - 1), block_j & (blocks - 1)]
        passes = z0 + dz * (min(out_x, out_y, end) if dz < 0 else t) > highest
        t = max(t, min(out_x, out_y) if passes else (highest - z0) / dz if dz < 0 else t)
        j = min(max(int(np.floor(px + t * sx)), block_j * BLOCK), block_j * BLOCK + BLOCK - 1)
        i = min(max(int(np.floor(py + t * sy)), block_i * BLOCK), block_i * BLOCK + BLOCK - 1)
        if passes:
            if out_x < out_y:
                j = (block_j + forward_x) * BLOCK - 1 + forward_x
            else:
                i = (block_i + forward_y) * BLOCK - 1 + forward_y
            continue
        while t < end and j // BLOCK == block_j and i // BLOCK == block_i:
            out_x = (j + forward_x - px) * qx if sx != 0 else 1e30
            out_y = (i + forward_y - py) * qy if sy != 0 else 1e30
            out = max(min(out_x, out_y), t)
            met = _met_in_cell(heights, i, j, px + t * sx - j, py + t * sy - i, z0 + t * dz, sx, sy, dz, out - t)
            if met >= 0:
                return (end, water) if t + met >= end else (t + met, False)
            t = out
            if out_x < out_y:
                j += 2 * forward_x - 1
            else:
                i += 2 * forward_y - 1
    return end, water


@lazy_kernel(inline="always", **_QUICK)
def _met_in_cell(heights: Float32Array, i: int, j: int, u: float, v: float, z: float, su: float, sv: float, sz: float,
                 most: float) -> float:
    """Depth from (u, v), cells from node (i, j), and z up to the bilinear surface; -1 if that is not within `most`."""
    n = heights.shape[0]
    j0, i0 = j & (n - 1), i & (n - 1)
    j1, i1 = (j0 + 1) & (n - 1), (i0 + 1) & (n - 1)
    h00, h01, h10, h11 = heights[i0, j0], heights[i0, j1], heights[i1, j0], heights[i1, j1]
    if min(z, z + sz * most) > max(h00, h01, h10, h11):
        return -1.0
    b, c, e = float(h01) - h00, float(h10) - h00, float(h11) - h10 - h01 + h00
    above = z - (h00 + b * u + c * v + e * u * v)
    if above <= 0:
        return 0.0
    change = sz - b * su - c * sv - e * (u * sv + v * su)
    square = change * change + 4 * e * su * sv * above
    if square >= 0 and np.sqrt(square) > change:
        met = 2 * above / (np.sqrt(square) - change)
        if met <= most:
            return float(met)
    return -1.0


@lazy_kernel(inline="always", **_QUICK)
def _add_ground(cover: Float32Array, detail: Float32Array, east: float, north: float, step: float,
                level: Float32Array) -> None:
    """Adds to `level` (channels,) the ground at a place, averaged over about 2^step m."""
    gx, gy = east / CELL_M, north / CELL_M
    left, low = int(np.floor(gx)), int(np.floor(gy))
    fx, fy = np.float32(gx - left), np.float32(gy - low)
    n, channels = cover.shape[0], len(level)
    j0, i0 = left & (n - 1), low & (n - 1)
    j1, i1 = (j0 + 1) & (n - 1), (i0 + 1) & (n - 1)
    one = np.float32(1)
    w00, w01, w10, w11 = (one - fx) * (one - fy), fx * (one - fy), (one - fx) * fy, fx * fy
    grain = 0.75 * _detail(detail, step - _FINE_LOG, east / _FINE_M, north / _FINE_M)
    grain += 0.65 * _detail(detail, step - _MIDDLE_LOG, east / _MIDDLE_M + 183, north / _MIDDLE_M - 99)
    contrast = (w00 * cover[i0, j0, channels] + w01 * cover[i0, j1, channels]
                + w10 * cover[i1, j0, channels] + w11 * cover[i1, j1, channels])
    gain = np.float32(1 + contrast * grain)
    for c in range(channels):
        level[c] += gain * (w00 * cover[i0, j0, c] + w01 * cover[i0, j1, c] + w10 * cover[i1, j0, c]
                            + w11 * cover[i1, j1, c])


@lazy_kernel(inline="always", **_QUICK)
def _sky(sky: Float32Array, channel: int, up: float) -> float:
    """Level of the sky at the sine `up` of the angle over the horizon."""
    share = np.sqrt(min(max(up, 0.0), 1.0))
    return float(sky[channel, 0] + share * (sky[channel, 1] - sky[channel, 0]))


@lazy_kernel(**_QUICK)
def _ripples(waves: Float32Array, lives: FloatArray, stream: FloatArray, step: float, east: float,
             north: float) -> float:
    """Height of the ripples: two generations that drift with the stream and fade into one another."""
    period = TILE * CELL_M
    middle, slope = stream[1] * np.sin(stream[2] * east), stream[1] * stream[2] * np.cos(stream[2] * east)
    across = ((north - middle + period / 2) % period - period / 2) / (stream[0] + 1)
    along = stream[3] * max(1 - across * across, 0.0) / np.sqrt(1 + slope * slope)
    ripple = 0.0
    for k in range(2):
        if lives[k, 1] > 0:
            x = east - along * lives[k, 0] + lives[k, 2]
            y = north - along * slope * lives[k, 0] + lives[k, 3]
            fine = _detail(waves, step - _RIPPLE_LOG, x / _RIPPLE_M, y / _RIPPLE_M)
            ripple += lives[k, 1] * (0.6 * fine + 0.8 * _detail(waves, step - _WAVE_LOG, x / _WAVE_M, y / _WAVE_M))
    return float(ripple)


@lazy_kernel(inline="always", **_QUICK)
def _add_water(color: Float32Array, sky: Float32Array, ripple: float, up: float, rays: int,
               level: Float32Array) -> None:
    """Adds to `level` (channels,) what `rays` rays see of the water: its colour and the sky it mirrors."""
    grazing = max(1 + up - 0.05 * ripple, 0.0)
    mirrored = min(0.02 + 0.98 * grazing * grazing * grazing * grazing * grazing, 1.0)  # Schlick (1994)
    for c in range(len(level)):
        seen = color[c] * (1 + 0.13 * ripple)
        level[c] += np.float32(rays * (seen + mirrored * (_sky(sky, c, -up + 0.06 * ripple) - seen)))


@lazy_kernel(**_QUICK)
def render_rows(rays: FloatArray, land: Land, water: Water, sight: Sight, sky: Float32Array, image: FloatImage) -> None:
    """Levels of an image without noise. Haze, ripples and mirrored sky are the same for all rays of a pixel.

    Args:
        rays: (h, w, 2), x / z and y / z in the camera's axes at the pixels' centres; NaN: the lens shows nothing.
        land: the ground.
        water: the water.
        sight: the camera.
        sky: (channels, 2) float32, levels at the horizon and at the zenith.
        image: (h, w, channels) float32, is filled.
    """
    heights, tops, cover, detail = land
    color, waves, lives, stream = water
    start, R, pixel_rad, wse_m, top_m = sight
    level = np.empty(image.shape[2], np.float32)
    for v in range(image.shape[0]):
        for u in range(image.shape[1]):
            image[v, u, :] = 0
            x, y = rays[v, u, 0], rays[v, u, 1]
            across_x, across_y, along_x, along_y = _derivatives(rays, v, u)
            if not np.isfinite(x + y + across_x + across_y + along_x + along_y):
                continue
            up = (R[2, 0] * x + R[2, 1] * y + R[2, 2]) / np.sqrt(x * x + y * y + 1)
            many = min(max(int(1.7 / max(-up, 0.05) + 0.5), 2), _MOST_RAYS) if up < _SKY_UP else 2
            apart = pixel_rad * max(0.5, 1 / (many * max(-up, 0.1)))
            level[:] = 0
            nearest, wet, east, north = FAR_M, 0, 0.0, 0.0
            for k in range(2 * many):
                du, dv = 0.5 * (k % 2) - 0.25, (k // 2 + 0.5) / many - 0.5
                rx, ry = x + du * across_x + dv * along_x, y + du * across_y + dv * along_y
                dx = R[0, 0] * rx + R[0, 1] * ry + R[0, 2]
                dy = R[1, 0] * rx + R[1, 1] * ry + R[1, 2]
                t, is_water = _depth(heights, tops, start, top_m, wse_m, dx, dy, R[2, 0] * rx + R[2, 1] * ry + R[2, 2])
                nearest = min(nearest, t)
                if t >= FAR_M:
                    for c in range(len(level)):
                        level[c] += np.float32(_sky(sky, c, up))
                elif is_water:
                    wet += 1
                    east, north = start[0] + t * dx, start[1] + t * dy
                else:
                    _add_ground(cover, detail, start[0] + t * dx, start[1] + t * dy, np.log2(t * apart), level)
            if wet > 0:
                ripple = _ripples(waves, lives, stream, np.log2(2 * nearest * apart), east, north)
                _add_water(color, sky, ripple, up, wet, level)
            clear = np.float32(np.exp(-nearest / _HAZE_M)) if nearest < FAR_M else np.float32(1)
            for c in range(len(level)):
                image[v, u, c] = sky[c, 0] + clear * (level[c] / np.float32(2 * many) - sky[c, 0])


@lazy_kernel(inline="always", **_QUICK)
def _derivatives(rays: FloatArray, v: int, u: int) -> tuple[float, float, float, float]:
    """Change of the ray per pixel, x and y, to the right and down."""
    a, b = max(u - 1, 0), min(u + 1, rays.shape[1] - 1)
    c, d = max(v - 1, 0), min(v + 1, rays.shape[0] - 1)
    return ((rays[v, b, 0] - rays[v, a, 0]) / (b - a), (rays[v, b, 1] - rays[v, a, 1]) / (b - a),
            (rays[d, u, 0] - rays[c, u, 0]) / (d - c), (rays[d, u, 1] - rays[c, u, 1]) / (d - c))


@lazy_kernel(**_QUICK)
def depths(rays: FloatArray, land: Land, sight: Sight) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Depth (n,), m, along rays (n, 2), inf where nothing is met, and whether it is water."""
    found, wet = np.empty(len(rays)), np.zeros(len(rays), np.bool_)
    start, R, _, wse_m, top_m = sight
    for k in range(len(rays)):
        x, y = rays[k]
        t, is_water = _depth(land.heights, land.tops, start, top_m, wse_m, R[0, 0] * x + R[0, 1] * y + R[0, 2],
                             R[1, 0] * x + R[1, 1] * y + R[1, 2], R[2, 0] * x + R[2, 1] * y + R[2, 2])
        found[k], wet[k] = t if t < FAR_M else np.inf, is_water
    return found, wet


@lazy_kernel(**_QUICK)
def draw_board(rays: FloatArray, land: Land, sight: Sight, centre: FloatArray, size_m: float,
               box: tuple[int, int, int, int], image: FloatImage) -> None:
    """Draws a level board into the pixels of `box` (left, top, right, bottom), from many rays each.

    Rays are weighted by a tent of two pixels' width, as optics with a blur of 0.4 px (standard deviation) do, and lie
    on a Fibonacci lattice, which is in line with no edge. The quadrants to the north-east and south-west are white.
    Ground in front of the board hides it.
    """
    start, R, _, wse_m, top_m = sight
    for v in range(max(box[1], 0), min(box[3] + 1, image.shape[0])):
        for u in range(max(box[0], 0), min(box[2] + 1, image.shape[1])):
            across_x, across_y, along_x, along_y = _derivatives(rays, v, u)
            covered, total, weights = 0.0, 0.0, 0.0
            for k in range(_BOARD_RAYS):
                du, dv = 2 * (((k + 0.5) * _GOLDEN) % 1) - 1, 2 * (k + 0.5) / _BOARD_RAYS - 1
                weight = (1 - abs(du)) * (1 - abs(dv))
                weights += weight
                x = rays[v, u, 0] + du * across_x + dv * along_x
                y = rays[v, u, 1] + du * across_y + dv * along_y
                dx, dy = R[0, 0] * x + R[0, 1] * y + R[0, 2], R[1, 0] * x + R[1, 1] * y + R[1, 2]
                dz = R[2, 0] * x + R[2, 1] * y + R[2, 2]
                t = (centre[2] - start[2]) / min(dz, -1e-9)
                east, north = start[0] + t * dx - centre[0], start[1] + t * dy - centre[1]
                if (dz < 0 and max(abs(east), abs(north)) <= size_m / 2
                        and _depth(land.heights, land.tops, start, top_m, wse_m, dx, dy, dz)[0] > t):
                    covered += weight
                    total += weight * (228.0 if east * north > 0 else 24.0)
            share = np.float32(covered / weights)
            for c in range(image.shape[2]):
                image[v, u, c] = (1 - share) * image[v, u, c] + np.float32(total / weights)
