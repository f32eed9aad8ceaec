"""RMSE of homologous points: how far the same ground lies apart in two stabilised pictures (Zhang et al. 2023).

The points are SIFT's (Lowe 2004), as in the paper, and found in the stabilised pictures themselves: nothing of the
tracker, neither its features nor its inliers, takes part in judging it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import cv2
import numpy as np

from stab_ros.core.geometry import apply, is_plausible, level_scale
from stab_ros.core.types import BoolArray, FloatArray, Gray, Homography, IdArray

_TILES = 32
_TILE_PX = 96
_AREA_PX = 300_000  # what SIFT looks at, all tiles together; a smaller picture is one tile
_KEY_POINTS = 1280  # of a picture, the strongest of each tile
_EDGE_RATIO = 5.0  # stricter than Lowe's 10: along an edge a key point is placed badly
_ALLOWED_SHARE = 0.3  # of a tile
_CLEAR_PX = 8.0  # a key point keeps its own size and this from seams and black borders
_RATIO = 0.8  # best to second distance of descriptors, Lowe 2004, section 7.1
_GATE_PX = 1.0  # what lies further from the common plane is a mismatch or water
_SMALLER = 3  # times smaller than the largest set of agreeing points, a set is no ground
_FEWEST = 8  # homologous points for an RMSE
_ENOUGH = 24  # with fewer, the picture may lie elsewhere altogether
_AWAY_PX = 12.0  # tiles that lie this far away must follow: else only what moved least would be found again


@dataclass(frozen=True, eq=False)
class Rmse:
    """RMSE of a picture against the reference and against the picture before, px; None: too few points, or no picture.

    checkpoints: the number of points in the comparison with the reference, also when they are too few.
    ref_H_cur: the plane of the ground that they agree on within a pixel, None where there is none.
    """

    reference_px: float | None
    previous_px: float | None
    checkpoints: int
    ref_H_cur: Homography | None


class HomologousPoints:
    """Finds the ground of the reference again in other pictures and says how far from there it lies.

    Homologous is what SIFT matches both ways and what agrees on one homography within a pixel. This takes out
    mismatches and moving water, and nothing else: the RMSE is of coordinates, not of residuals of that homography.

    SIFT looks at some tiles only, chosen in the reference for texture and spread, so that a check costs the same at
    every resolution. Other pictures are searched in the same tiles and, where the common plane turns out to lie
    further away, in tiles that follow it. If hardly anything is found, SIFT of small pictures tells where to look.
    """

    def __init__(self, reference: Gray, allowed: BoolArray) -> None:
        """reference: (h, w) uint8. allowed: (h, w) bool, where static ground may be looked for.

        Raises:
            ValueError: `allowed` has another shape.
        """
        if allowed.shape != reference.shape:
            raise ValueError(f"allowed is {allowed.shape}, it must be {reference.shape} as the reference")
        self._picture = reference
        self._corners, tile_size = _chosen_tiles(reference, allowed)
        self._tiles = np.arange(len(self._corners))
        self._sift = _TileSift(tile_size, len(self._corners))
        found = self._sift.key_points(reference, np.ones_like(allowed), self._tiles, self._corners)
        column, row = np.round(found.px).astype(np.int64).T
        self._points = found[allowed[row, column]]
        # a point with several orientations has several descriptors, but is one place and counts once
        self._place_px, place = np.unique(self._points.px, axis=0, return_inverse=True)
        self._place = place.reshape(-1)

    def measure(self, current: Gray, valid: BoolArray, previous: Gray | None = None,
                previous_valid: BoolArray | None = None) -> Rmse:
        """Eq. 7 against the reference, and against the picture before over the points found in all three.

        Only what is ground in the comparison with the reference counts in the other: water keeps its texture from one
        picture to the next, and would win.

        current, previous: (h, w) uint8, as large as the reference. valid: (h, w) bool, False in the black border.

        Raises:
            ValueError: a picture or its `valid` has another shape.
        """
        now = self._found_again(current, valid, self._tiles, self._corners)
        reference_px, previous_px = rmse(self._place_px[now.place], now.px), None
        if reference_px is not None and previous is not None and previous_valid is not None:
            tiles = np.unique(self._points.tile[np.isin(self._place, now.place)])
            before = self._found_again(previous, previous_valid, tiles, now.corners)
            _, here, there = np.intersect1d(now.place, before.place, return_indices=True)
            previous_px = rmse(before.px[there], now.px[here])
        return Rmse(reference_px, previous_px, len(now.place), now.ref_H_cur)

    def _found_again(self, picture: Gray, valid: BoolArray, tiles: IdArray, corners: IdArray) -> _Ground:
        """The reference's points in `picture`, searched with `tiles` at `corners` first, and then where they lie."""
        if picture.shape != self._picture.shape or valid.shape != picture.shape:
            raise ValueError(f"a picture of {picture.shape} and valid of {valid.shape}, both must be "
                             f"{self._picture.shape} as the reference")
        found = self._found_at(picture, valid, tiles, corners)
        plane = found.ref_H_cur if len(found.place) >= _ENOUGH else self._overview.ref_H_cur(picture)
        if plane is None:
            return found
        followed = self._following(plane)
        if np.abs(followed - corners)[tiles].max(initial=0) < _AWAY_PX:
            return found
        return max(found, self._found_at(picture, valid, tiles, followed), key=lambda ground: len(ground.place))

    def _found_at(self, picture: Gray, valid: BoolArray, tiles: IdArray, corners: IdArray) -> _Ground:
        found = self._sift.key_points(picture, valid, tiles, corners)
        in_reference, in_picture = _matches(self._points, found, tiles)
        ref_H_cur, agrees = _plane(found.px[in_picture], self._points.px[in_reference], picture.shape)
        place, first = np.unique(self._place[in_reference[agrees]], return_index=True)
        return _Ground(place, found.px[in_picture[agrees]][first], ref_H_cur, corners)

    def _following(self, ref_H_cur: Homography) -> IdArray:
        """(tiles, 2): corners of the tiles where the plane lies, as far as the picture reaches."""
        middle = (self._sift.size - 1) / 2
        corners = np.round(apply(np.linalg.inv(ref_H_cur), self._corners + middle) - middle)
        return np.clip(corners, 0, np.array(self._picture.shape[::-1]) - self._sift.size).astype(np.int64)

    @cached_property
    def _overview(self) -> _Overview:
        return _Overview(self._picture)


def rmse(ones_px: FloatArray, others_px: FloatArray) -> float | None:
    """Zhang et al. 2023, Eq. 7: sqrt(sum((x_r - x_s)^2 + (y_r - y_s)^2) / N) of (N, 2); None for fewer than 8."""
    if len(ones_px) < _FEWEST:
        return None
    return float(np.sqrt(np.mean(np.sum((ones_px - others_px) ** 2, axis=1))))


@dataclass(frozen=True, eq=False)
class _KeyPoints:
    """px: (n, 2) float64. tile: (n,) int64, where they were found. descriptor: (n, 128) float32, whole numbers."""

    px: FloatArray
    tile: IdArray
    descriptor: FloatArray

    def __getitem__(self, keep: BoolArray) -> _KeyPoints:
        return _KeyPoints(self.px[keep], self.tile[keep], self.descriptor[keep])


@dataclass(frozen=True, eq=False)
class _Ground:
    """What was found again of the reference. place: (n,) int64, which of its points, ascending. px: (n, 2), where.

    ref_H_cur: the plane they agree on, if any. corners: (tiles, 2) int64, of the tiles they were found in.
    """

    place: IdArray
    px: FloatArray
    ref_H_cur: Homography | None
    corners: IdArray


class _TileSift:
    """SIFT of tiles, each on its own; what has been seen lately is not computed again (the picture before)."""

    def __init__(self, size: IdArray, tiles: int) -> None:
        """size: (2,) width and height of each of `tiles` tiles, px."""
        self.size = size
        self._sift = cv2.SIFT.create(nfeatures=_KEY_POINTS // max(1, tiles), edgeThreshold=_EDGE_RATIO)
        self._remembered = lru_cache(maxsize=4 * tiles)(self._detected)

    def key_points(self, picture: Gray, valid: BoolArray, tiles: IdArray, corners: IdArray) -> _KeyPoints:
        """Those of `tiles`, whose places are `corners` (all tiles, 2), clear of seams and of what is not valid."""
        px, tile, descriptor = [np.empty((0, 2))], [np.empty(0, np.int64)], [np.empty((0, 128), np.float32)]
        for number in tiles:
            (x, y), (width, height) = corners[number], self.size
            cut = np.s_[y : y + height, x : x + width]
            at, reach, described = self._remembered(picture[cut].tobytes())
            column, row = np.round(at).astype(np.int64).T
            clear = _room_px(valid[cut])[row, column] >= reach
            px.append(at[clear] + (x, y))
            tile.append(np.full(clear.sum(), number))
            descriptor.append(described[clear])
        return _KeyPoints(np.concatenate(px), np.concatenate(tile), np.concatenate(descriptor))

    def _detected(self, tile: bytes) -> tuple[FloatArray, FloatArray, FloatArray]:
        """(n, 2) px, (n,) px they need about them, (n, 128) descriptors."""
        return _sift(self._sift, np.frombuffer(tile, np.uint8).reshape(self.size[::-1]))


def _sift(sift: cv2.SIFT, gray: Gray) -> tuple[FloatArray, FloatArray, FloatArray]:
    points, descriptor = sift.detectAndCompute(gray, None)
    if not points:
        return np.empty((0, 2)), np.empty(0), np.empty((0, 128), np.float32)
    return np.array([p.pt for p in points]), np.array([p.size for p in points]) + _CLEAR_PX, descriptor


def _room_px(valid: BoolArray) -> FloatArray:
    """(h, w): how far each pixel of a tile lies from its seam and from what is not valid, px."""
    framed = np.pad(valid, 1).astype(np.uint8)
    return np.asarray(cv2.distanceTransform(framed, cv2.DIST_L2, cv2.DIST_MASK_PRECISE))[1:-1, 1:-1]


def _matches(ones: _KeyPoints, others: _KeyPoints, tiles: IdArray) -> tuple[IdArray, IdArray]:
    """Indices (n,) into both of what is each other's best match within its tile, and clearly better than the second."""
    found = [(np.empty(0, np.int64), np.empty(0, np.int64))]
    for tile in tiles:
        i, j = np.flatnonzero(ones.tile == tile), np.flatnonzero(others.tile == tile)
        a, b = _mutual(ones.descriptor[i], others.descriptor[j])
        found.append((i[a], j[b]))
    one, other = zip(*found, strict=True)
    return np.concatenate(one), np.concatenate(other)


def _mutual(ones: FloatArray, others: FloatArray) -> tuple[IdArray, IdArray]:
    # whole numbers up to 128 * 255^2 < 2^24: exact in float32, however the sum is ordered
    squares = [np.sum(d * d, axis=1) for d in (ones, others)]
    distance2 = squares[0][:, None] + squares[1] - 2 * (ones @ others.T)
    one, other = np.nonzero(_clearly_best(distance2) & _clearly_best(distance2.T).T)
    return one, other


def _clearly_best(distance2: FloatArray) -> BoolArray:
    """(n, m) bool: the smallest of its row, and by the ratio test no other is nearly as small."""
    if 0 in distance2.shape:
        return np.zeros(distance2.shape, bool)
    padded = np.pad(distance2, ((0, 0), (0, 1)), constant_values=np.inf)  # a row may have no second
    best, second = np.partition(padded, 1, axis=1)[:, :2].T
    return np.asarray((distance2 == best[:, None]) & (best < _RATIO**2 * second)[:, None])


def _plane(current_px: FloatArray, reference_px: FloatArray, shape: tuple[int, ...],
           gate_px: float = _GATE_PX) -> tuple[Homography | None, BoolArray]:
    """The homography of the ground, if a camera can have made it, and which of the pairs (n, 2) lie within its gate.

    Ground frames the water: of the two largest sets that agree, the one that reaches further counts, if not by far the
    smaller. Their numbers alone do not tell where half of the picture is water that keeps its texture.
    """
    H, agrees = _consensus(current_px, reference_px, shape, gate_px)
    rest = np.flatnonzero(~agrees)
    if H is None or len(rest) < agrees.sum() / _SMALLER:
        return H, agrees
    other_H, others = _consensus(current_px[rest], reference_px[rest], shape, gate_px)
    other = np.zeros_like(agrees)
    other[rest[others]] = True
    if other.sum() * _SMALLER < agrees.sum() or _reach(reference_px[other]) <= _reach(reference_px[agrees]):
        return H, agrees
    return other_H, other


def _consensus(current_px: FloatArray, reference_px: FloatArray, shape: tuple[int, ...],
               gate_px: float) -> tuple[Homography | None, BoolArray]:
    """By LO-RANSAC (Chum et al. 2003), whose samples OpenCV draws the same every time, within half of the gate."""
    nothing = None, np.zeros(len(current_px), bool)
    if len(current_px) < _FEWEST:
        return nothing
    H, _ = cv2.findHomography(current_px, reference_px, cv2.USAC_DEFAULT, gate_px / 4, None, 5000, 0.9999)
    if H is None or not is_plausible(H, (shape[1], shape[0])):
        return nothing
    return H, np.hypot(*(apply(H, current_px) - reference_px).T) < gate_px


def _reach(px: FloatArray) -> float:
    """Number of points times the area over which they scatter, px^2."""
    return float(len(px) * np.sqrt(max(0.0, np.linalg.det(np.cov(px.T)))))


class _Overview:
    """SIFT of whole small pictures: a rough plane for a picture that lies far away."""

    def __init__(self, reference: Gray) -> None:
        self._level = max(0, int(np.ceil(np.log2(reference.size / _AREA_PX) / 2)))
        self._sift = cv2.SIFT.create(nfeatures=_KEY_POINTS)
        self._px, _, self._descriptor = self._found(reference)

    def ref_H_cur(self, picture: Gray) -> Homography | None:
        """Good to some px; None if hardly anything is found again."""
        px, _, descriptor = self._found(picture)
        i, j = _mutual(self._descriptor, descriptor)
        H, agrees = _plane(px[j], self._px[i], picture.shape, 2.0 ** (self._level + 1))
        return H if agrees.sum() >= _FEWEST else None

    def _found(self, gray: Gray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """In px of the large picture; an incomplete last row or column of blocks is left out."""
        block = 2**self._level
        height, width = gray.shape[0] // block, gray.shape[1] // block
        small = cv2.resize(gray[: height * block, : width * block], (width, height), interpolation=cv2.INTER_AREA)
        px, reach, descriptor = _sift(self._sift, small)
        return apply(np.linalg.inv(level_scale(self._level)), px), reach, descriptor


def _chosen_tiles(reference: Gray, allowed: BoolArray) -> tuple[IdArray, IdArray]:
    """Corners (tiles, 2) and size (2,): the best textured place of each cell of a grid, or the whole picture."""
    size = np.array(reference.shape[::-1])
    if reference.size <= _AREA_PX or size.min() <= _TILE_PX:
        return np.zeros((1, 2), np.int64), size
    score = _texture_of_tiles(reference, allowed)
    most = size // _TILE_PX
    corners = np.empty((0, 2), np.int64)
    fewest = min(most[0], max(1, round(np.sqrt(_TILES * size[0] / size[1]))))
    for columns in range(int(fewest), int(most[0]) + 1):
        rows = min(most[1], max(1, round(columns * size[1] / size[0])))
        corners = _best_of_cells(score, size, columns, int(rows))
        if len(corners) >= 0.75 * _TILES:
            break
    best = np.argsort(-score[corners[:, 1], corners[:, 0]], kind="stable")[:_TILES]
    return corners[np.sort(best)], np.array([_TILE_PX, _TILE_PX])


def _texture_of_tiles(reference: Gray, allowed: BoolArray) -> FloatArray:
    """For every corner of a tile: how much texture it holds where that is allowed; 0 where too little is allowed."""
    corner = np.sqrt(np.maximum(cv2.cornerMinEigenVal(reference, 5), 0)) * allowed
    corner = np.minimum(corner, np.percentile(corner[::4, ::4], 95))  # many corners, not a few strong ones
    inside = np.s_[: reference.shape[0] - _TILE_PX + 1, : reference.shape[1] - _TILE_PX + 1]
    texture, share = (cv2.blur(a.astype(np.float32), (_TILE_PX, _TILE_PX), anchor=(0, 0))[inside]
                      for a in (corner, allowed))
    return np.asarray(texture * (share >= _ALLOWED_SHARE))


def _best_of_cells(score: FloatArray, size: IdArray, columns: int, rows: int) -> IdArray:
    x, y = (np.linspace(0, n, cells + 1).astype(int) for n, cells in zip(size, (columns, rows), strict=True))
    corners = []
    for top, bottom in zip(y, y[1:] - _TILE_PX + 1, strict=False):
        for left, right in zip(x, x[1:] - _TILE_PX + 1, strict=False):
            row, column = np.unravel_index(score[top:bottom, left:right].argmax(), (bottom - top, right - left))
            if score[top + row, left + column] > 0:
                corners.append((left + column, top + row))
    return np.array(corners, np.int64).reshape(-1, 2)
