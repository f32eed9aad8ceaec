"""A reach of a river with relief: heights of the ground, its colours in sunlight, and boards laid out on it.

The river flows to the east. Heights and colours lie on a grid of `CELL_M`, linear between its nodes in both directions,
and repeat after `PERIOD_M` to the east and to the north, so that views up to the horizon need no more memory. Finer
detail is noise that the renderer adds.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from stab_ros.core.errors import InputError
from stab_ros.core.kernels import lazy_kernel
from stab_ros.core.types import BoolArray, Float32Array, FloatArray, IdArray
from stab_ros.synthetic.textures import TILE, natural_texture

CELL_M = 0.25
PERIOD_M = TILE * CELL_M  # 256 m
BLOCK = 8  # cells of a block of `Reach.tops_m`

_SUN = np.array([0.5, 0.6, 0.62])  # direction of the sun in the map, of length 1 within 1 %
_SHADOW = 0.55
_GREY = np.array([0.114, 0.587, 0.299])  # weights of blue, green and red
# blue, green, red
_GRAVEL, _MEADOW, _LEAVES, _STONE = (
    np.array(c, float) for c in ((138, 152, 160), (62, 108, 94), (36, 78, 62), (140, 146, 150)))
_DETAIL = {"gravel": 0.15, "meadow": 0.13, "leaves": 0.28, "stone": 0.12}
_CLEARING_M = 5.0  # around boards, without trees and boulders
_BOARD_ABOVE_M = 0.10  # the ground below


@dataclass(frozen=True)
class Board:
    """A level square with black and white quadrants on the ground, whose centre is known in three dimensions.

    Attributes:
        name: of the point.
        east_m: of its centre.
        north_m: of its centre.
        size_m: side.
        stand_m: height of the stand that carries it.
        control: whether it is a ground control point; else a checkpoint.
    """

    name: str
    east_m: float
    north_m: float
    size_m: float = 0.8
    stand_m: float = 0.0
    control: bool = True


@dataclass(frozen=True)
class ReachSettings:
    """Shape of a reach.

    Attributes:
        half_width_m: of the river at `wse_m` = 0.
        bend_m: amplitude of the centre line over one period.
        bank_m: mean height of the banks over z = 0.
        relief_m: standard deviation of their heights.
        trees: number in a period.
        boulders: number in a period.
        speed_m_s: of the water in mid-stream.
        dry: whether there is no river: level ground at z = 0 without trees and boulders.
    """

    half_width_m: float = 12.0
    bend_m: float = 4.0
    bank_m: float = 1.6
    relief_m: float = 0.4
    trees: int = 420
    boulders: int = 700
    speed_m_s: float = 1.2
    dry: bool = False

    def middle_m(self, east_m: float) -> float:
        """North of mid-stream."""
        return self.bend_m * math.sin(2 * math.pi / PERIOD_M * east_m)


@dataclass(frozen=True, eq=False)
class Reach:
    """The ground of a reach.

    Attributes:
        height_m: (n, n) float32, z of the node in row i (north i * CELL_M) and column j (east j * CELL_M).
        tops_m: (n / BLOCK, n / BLOCK) float32, the highest node of each block of cells.
        cover: (n, n, channels + 1) float32, levels in sunlight (bgr or grey) and contrast of the fine detail.
        settings: its shape.
        board_m: (N, 3), centres of the boards.
    """

    height_m: Float32Array
    tops_m: Float32Array
    cover: Float32Array
    settings: ReachSettings
    board_m: FloatArray

    def ground_height_m(self, east_m: FloatArray, north_m: FloatArray) -> FloatArray:
        """Height (N,) of the ground at places (N,); trees and boulders are part of the ground."""
        return _interpolated(self.height_m, east_m, north_m)


@lru_cache(maxsize=4)
def make_reach(settings: ReachSettings, boards: tuple[Board, ...], seed: int, color: bool) -> Reach:
    """Generates a reach; the last ones are kept, since this takes a second.

    Raises:
        InputError: a board lies in the river's bed, or two have one name.
    """
    if len({board.name for board in boards}) < len(boards):
        raise InputError("two boards have one name, names must differ")
    north, east = np.meshgrid(np.arange(TILE) * CELL_M, np.arange(TILE) * CELL_M, indexing="ij")
    from_shore = shore_distance_m(settings, east, north)
    ground = np.zeros((TILE, TILE)) if settings.dry else _banks(settings, from_shore, seed)
    surface, leaves, stones = ground.copy(), np.zeros(ground.shape, bool), np.zeros(ground.shape, bool)
    if not settings.dry:
        _drop_boulders(settings, boards, seed, surface, stones)
        _plant_trees(settings, boards, seed, surface, leaves)
    heights = surface.astype(np.float32)
    cover = _cover(heights, from_shore, leaves, stones, seed, settings.dry)
    if not color:
        cover = np.concatenate([cover[..., :3] @ _GREY[:, None], cover[..., 3:]], axis=2)
    return Reach(heights, _tops(heights), np.ascontiguousarray(cover, np.float32), settings, _laid(boards, heights))


def shore_distance_m(settings: ReachSettings, east_m: FloatArray | float, north_m: FloatArray | float) -> FloatArray:
    """Distance from the nominal shore along the north, m, negative in the river; a period further is the next river."""
    if settings.dry:
        return np.full(np.shape(east_m), np.inf)
    middle = settings.bend_m * np.sin(2 * math.pi / PERIOD_M * east_m)
    across = (north_m - middle + PERIOD_M / 2) % PERIOD_M - PERIOD_M / 2
    return np.asarray(np.abs(across) - settings.half_width_m)


def _banks(settings: ReachSettings, from_shore: FloatArray, seed: int) -> FloatArray:
    """A bed 1 m deep, a gravel shore, and banks with relief."""
    broad = natural_texture([seed, 70], 2.0, 160.0).astype(float)
    rough = natural_texture([seed, 71], 1.4, 40.0).astype(float)
    depth = 1.0
    rise = _smooth(-7.0, 11.0, from_shore + 1.2 * np.tanh(broad))
    inland = _smooth(1.0, 14.0, from_shore)
    return np.asarray(-depth + (depth + settings.bank_m) * rise
                      + settings.relief_m * inland * broad + 0.06 * rough)


def _smooth(low: float, high: float, x: FloatArray) -> FloatArray:
    t = np.clip((x - low) / (high - low), 0.0, 1.0)
    return np.asarray(t * t * (3 - 2 * t))


def _drop_boulders(settings: ReachSettings, boards: tuple[Board, ...], seed: int, surface: FloatArray,
                   stones: BoolArray) -> None:
    rng = np.random.default_rng([seed, 72])
    for _ in range(settings.boulders):
        east, north, radius = rng.uniform(0, PERIOD_M), rng.uniform(0, PERIOD_M), 0.35 * rng.pareto(2.5) + 0.35
        if -2.0 < shore_distance_m(settings, east, north) < 7.0 and _clear(boards, east, north):
            rows, columns, share = _disc(east, north, min(radius, 1.6))
            raised = surface[rows, columns] + 0.8 * min(radius, 1.6) * np.sqrt(1 - share)
            surface[rows, columns], stones[rows, columns] = raised, True


def _plant_trees(settings: ReachSettings, boards: tuple[Board, ...], seed: int, surface: FloatArray,
                 leaves: BoolArray) -> None:
    rng = np.random.default_rng([seed, 73])
    crowns = natural_texture([seed, 74], 0.7, 12.0)
    groups = natural_texture([seed, 75], 1.8, 200.0)
    for _ in range(settings.trees):
        east, north, radius = rng.uniform(0, PERIOD_M), rng.uniform(0, PERIOD_M), rng.uniform(1.2, 3.4)
        inland = shore_distance_m(settings, east, north) > 7.0 + radius
        grouped = groups[int(north / CELL_M) % TILE, int(east / CELL_M) % TILE] > -0.1
        if inland and grouped and _clear(boards, east, north):
            rows, columns, share = _disc(east, north, radius)
            crown = radius * rng.uniform(1.3, 2.2) * (1 - share) ** 0.45 * (1 + 0.09 * crowns[rows, columns])
            ground = surface[int(north / CELL_M) % TILE, int(east / CELL_M) % TILE]
            surface[rows, columns] = np.maximum(surface[rows, columns], ground + crown)
            leaves[rows, columns] = True


def _clear(boards: tuple[Board, ...], east: float, north: float) -> bool:
    def apart(a: float, b: float) -> float:
        return (a - b + PERIOD_M / 2) % PERIOD_M - PERIOD_M / 2
    return all(math.hypot(apart(east, board.east_m), apart(north, board.north_m)) > _CLEARING_M for board in boards)


def _disc(east: float, north: float, radius: float) -> tuple[IdArray, IdArray, FloatArray]:
    """Rows, columns and squared share of the radius of the nodes in a disc."""
    steps = np.arange(-math.ceil(radius / CELL_M) - 1, math.ceil(radius / CELL_M) + 2, dtype=np.int64)
    rows, columns = np.meshgrid(round(north / CELL_M) + steps, round(east / CELL_M) + steps, indexing="ij")
    share = ((rows * CELL_M - north) ** 2 + (columns * CELL_M - east) ** 2) / radius**2
    inside = share < 1
    return rows[inside] % TILE, columns[inside] % TILE, share[inside]


def _cover(heights: Float32Array, from_shore: FloatArray, leaves: BoolArray, stones: BoolArray, seed: int,
           dry: bool) -> FloatArray:
    """Levels in sunlight, bgr, and contrast of the detail, (n, n, 4)."""
    patches = natural_texture([seed, 76], 1.5, 100.0).astype(float)
    green = _smooth(-0.6, 0.6, (0 if dry else np.minimum(from_shore, 60) - 7.0) / 2.5 + patches)[..., None]
    cover = green * np.append(_MEADOW, _DETAIL["meadow"]) + (1 - green) * np.append(_GRAVEL, _DETAIL["gravel"])
    cover[..., :3] *= 1 + 0.07 * patches[..., None]
    cover[stones] = np.append(_STONE, _DETAIL["stone"])
    cover[leaves] = np.append(_LEAVES, _DETAIL["leaves"])
    wet = 0.7 + 0.3 * _smooth(0.0, 0.25, heights.astype(float))
    cover[..., :3] *= (_lit(heights) * (1 if dry else wet))[..., None]
    return np.asarray(cover)


def _lit(heights: Float32Array) -> FloatArray:
    """Brightness (n, n) by the angle to the sun (Lambert) and by cast shadows, 1 on level ground."""
    around = np.pad(heights.astype(float), 1, mode="wrap")
    slope_north, slope_east = (np.gradient(around, CELL_M, axis=axis)[1:-1, 1:-1] for axis in (0, 1))
    facing = (_SUN[2] - _SUN[0] * slope_east - _SUN[1] * slope_north) / np.sqrt(1 + slope_east**2 + slope_north**2)
    direct = np.clip(facing, 0.0, None) / _SUN[2]
    shadow = _shadows(heights, _SUN / np.hypot(*_SUN[:2]))
    return np.asarray((1 - _SHADOW) + _SHADOW * direct * (1 - shadow))


@lazy_kernel()
def _shadows(heights: Float32Array, sun: FloatArray) -> FloatArray:
    """Share (n, n) of the light that hills towards the sun take, walking towards it cell by cell."""
    n = len(heights)
    shadow = np.zeros((n, n))
    for i in range(n):
        for j in range(n):
            for step in range(1, 44):
                above = heights[int(i + step * sun[1] + 0.5) % n, int(j + step * sun[0] + 0.5) % n] - heights[i, j]
                lack = above - step * sun[2] * CELL_M
                if lack > 0:
                    shadow[i, j] = max(shadow[i, j], min(lack / 0.5, 1.0))
    return shadow


def _tops(heights: Float32Array) -> Float32Array:
    """The highest of the nodes at the corners of the cells of each block."""
    shifts = ((0, 0), (0, -1), (-1, 0), (-1, -1))
    corners = np.maximum.reduce([np.roll(heights, shift, axis=(0, 1)) for shift in shifts])
    blocks = corners.reshape(TILE // BLOCK, BLOCK, TILE // BLOCK, BLOCK)
    return np.asarray(blocks.max(axis=(1, 3)))


def _laid(boards: tuple[Board, ...], heights: Float32Array) -> FloatArray:
    """Centres (N, 3) of the boards, above the highest ground below each."""
    places = []
    for board in boards:
        steps = np.linspace(-0.75, 0.75, 13) * board.size_m
        east, north = (grid.ravel() for grid in np.meshgrid(board.east_m + steps, board.north_m + steps))
        ground = _interpolated(heights, east, north)
        if ground.min() < -0.5:
            raise InputError(f"board {board.name} lies in the bed of the river, it must lie on a bank")
        places.append((board.east_m, board.north_m, ground.max() + _BOARD_ABOVE_M + board.stand_m))
    return np.array(places).reshape(-1, 3)


def _interpolated(grid: Float32Array, east_m: FloatArray, north_m: FloatArray) -> FloatArray:
    """Values (N,) of a grid (n, n) at places (N,), linear in both directions, periodic."""
    x, y = np.asarray(east_m) / CELL_M, np.asarray(north_m) / CELL_M
    left, low = np.floor(x).astype(int), np.floor(y).astype(int)
    fx, fy = x - left, y - low
    a, b, c, d = (grid[(low + i) % TILE, (left + j) % TILE].astype(float) for i in (0, 1) for j in (0, 1))
    return np.asarray((1 - fy) * ((1 - fx) * a + fx * b) + fy * ((1 - fx) * c + fx * d))
