"""RMSE of homologous points: distance between the same ground points in two stabilized images (Zhang et al. 2023).

The points are SIFT key points (Lowe 2004), as in the paper, detected in the stabilized images themselves. The measure
is independent of the tracker: it uses neither its features nor its inliers.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import cv2
import numpy as np

from stab_ros.core.geometry import apply, is_plausible, level_scale
from stab_ros.core.types import BoolArray, FloatArray, Gray, Homography, IdArray
from stab_ros.metrics.camera_fixed import MOVED_PX, in_place

_TILES = 32
_TILE_PX = 96
_AREA_PX = 300_000  # total area of the tiles; a smaller image is a single tile
_KEY_POINTS = 1280  # per image, the strongest of each tile
_EDGE_RATIO = 5.0  # stricter than Lowe's 10, because key points along an edge are poorly localized
_ALLOWED_SHARE = 0.3  # smallest allowed share of a tile
_BORDER_PX = 8.0  # margin of a key point, beyond its size, to the tile's and the image's border
_RATIO = 0.8  # best to second distance of descriptors, Lowe 2004, section 7.1
_GATE_PX = 1.0  # inlier threshold of the ground plane; other matches are wrong or on water
_SIZE_RATIO = 3  # a consensus set this many times smaller than the largest is not ground
_MIN_POINTS = 8  # for an RMSE
_AT_REST_PX = 1.0  # median motion of a group that stands still in the picture
_SUFFICIENT_POINTS = 24  # with fewer, the coarse search is tried
_MAX_TILE_SHIFT_PX = 12.0  # with a larger shift the tiles are moved; otherwise points that moved least are preferred


@dataclass(frozen=True, eq=False)
class Rmse:
    """RMSE of an image against the reference and against the previous image.

    Attributes:
        reference_px: None with too few points.
        previous_px: None with too few points, or without a previous image.
        checkpoints: number of points in the comparison with the reference, even if they are too few.
        ref_H_cur: homography of the ground plane, None if there is none.
    """

    reference_px: float | None
    previous_px: float | None
    checkpoints: int
    ref_H_cur: Homography | None


class HomologousPoints:
    """Matches ground points of the reference in other images and measures their distances.

    Points are homologous if SIFT matches them mutually and they agree with one homography within a pixel. This removes
    wrong matches and moving water only: the RMSE is of coordinates, not of residuals of that homography.

    SIFT is limited to tiles, chosen in the reference by texture and spatial distribution, so that the cost does not
    depend on the resolution. Other images are searched in the same tiles and, if the ground plane has moved far, in
    tiles moved with it. If too few points are found, SIFT on reduced images gives a coarse homography.
    """

    def __init__(self, reference: Gray, allowed: BoolArray) -> None:
        """Detects the points of the reference.

        Args:
            reference: (h, w) uint8.
            allowed: (h, w) bool, where static ground may be.

        Raises:
            ValueError: `allowed` differs in shape.
        """
        if allowed.shape != reference.shape:
            raise ValueError(f"allowed is {allowed.shape}, it must be {reference.shape} as the reference")
        self._image = reference
        self._corners, tile_size = _chosen_tiles(reference, allowed)
        self._tiles = np.arange(len(self._corners))
        self._sift = _TileSift(tile_size, len(self._corners))
        found = self._sift.key_points(reference, np.ones_like(allowed), self._tiles, self._corners)
        column, row = np.round(found.px).astype(np.int64).T
        self._points = found[allowed[row, column]]
        # a key point with several orientations has several descriptors but counts once
        self._location_px, location = np.unique(self._points.px, axis=0, return_inverse=True)
        self._location = location.reshape(-1)

    def measure(self, current: Gray, valid: BoolArray, previous: Gray | None = None,
                previous_valid: BoolArray | None = None, previous_fixed_H_ref: Homography | None = None,
                *, fixed_H_ref: Homography | None = None) -> Rmse:
        """RMSE (Zhang et al. 2023, eq. 7) against the reference and against the previous image.

        The comparison with the previous image uses only the ground points of the comparison with the reference. Water
        keeps its texture between successive frames and would dominate otherwise.

        Args:
            current: (h, w) uint8, of the reference's size.
            valid: (h, w) bool, False in the black border of `current`.
            previous: (h, w) uint8; None without a previous image.
            previous_valid: (h, w) bool, of `previous`.
            previous_fixed_H_ref: (3, 3), of `previous`.
            fixed_H_ref: (3, 3), from a place in the reference to that in `current` where the same pixel of the camera
                is: what stays there is no ground. None: unknown.

        Raises:
            ValueError: an image or its mask differs in shape.
        """
        current_matches = self._match_ground(current, valid, self._tiles, self._corners, fixed_H_ref)
        reference_px, previous_px = rmse(self._location_px[current_matches.location], current_matches.px), None
        if reference_px is not None and previous is not None and previous_valid is not None:
            tiles = np.unique(self._points.tile[np.isin(self._location, current_matches.location)])
            previous_matches = self._match_ground(previous, previous_valid, tiles, current_matches.corners,
                                                  previous_fixed_H_ref)
            _, here, there = np.intersect1d(current_matches.location, previous_matches.location, return_indices=True)
            previous_px = rmse(previous_matches.px[there], current_matches.px[here])
        return Rmse(reference_px, previous_px, len(current_matches.location), current_matches.ref_H_cur)

    def _match_ground(self, image: Gray, valid: BoolArray, tiles: IdArray, corners: IdArray,
                      fixed_H_ref: Homography | None) -> _GroundMatches:
        """The reference's points in `image`: in `tiles` at `corners`, and again in moved tiles if necessary."""
        if image.shape != self._image.shape or valid.shape != image.shape:
            raise ValueError(f"an image of {image.shape} and valid of {valid.shape}, both must be "
                             f"{self._image.shape} as the reference")
        found = self._match_in_tiles(image, valid, tiles, corners, fixed_H_ref)
        plane = found.ref_H_cur if len(found.location) >= _SUFFICIENT_POINTS else self._coarse_sift.ref_H_cur(image)
        if plane is None:
            return found
        followed = self._moved_corners(plane)
        if np.abs(followed - corners)[tiles].max(initial=0) < _MAX_TILE_SHIFT_PX:
            return found
        moved = self._match_in_tiles(image, valid, tiles, followed, fixed_H_ref)
        return max(found, moved, key=lambda ground: len(ground.location))

    def _match_in_tiles(self, image: Gray, valid: BoolArray, tiles: IdArray, corners: IdArray,
                        fixed_H_ref: Homography | None) -> _GroundMatches:
        found = self._sift.key_points(image, valid, tiles, corners)
        in_reference, in_image = _matches(self._points, found, tiles)
        ref_H_cur, agrees = _ground(found.px[in_image], self._points.px[in_reference], image.shape, fixed_H_ref)
        location, first = np.unique(self._location[in_reference[agrees]], return_index=True)
        return _GroundMatches(location, found.px[in_image[agrees]][first], ref_H_cur, corners)

    def _moved_corners(self, ref_H_cur: Homography) -> IdArray:
        """Corners (tiles, 2) of the tiles moved with the ground plane, clipped to the image."""
        middle = (self._sift.size - 1) / 2
        corners = np.round(apply(np.linalg.inv(ref_H_cur), self._corners + middle) - middle)
        return np.clip(corners, 0, np.array(self._image.shape[::-1]) - self._sift.size).astype(np.int64)

    @cached_property
    def _coarse_sift(self) -> _CoarseSift:
        return _CoarseSift(self._image)


def rmse(ones_px: FloatArray, others_px: FloatArray) -> float | None:
    """RMSE of points (N, 2), px: sqrt(sum((x_r - x_s)^2 + (y_r - y_s)^2) / N) (Zhang et al. 2023, eq. 7).

    None for fewer than 8 points.
    """
    if len(ones_px) < _MIN_POINTS:
        return None
    return float(np.sqrt(np.mean(np.sum((ones_px - others_px) ** 2, axis=1))))


@dataclass(frozen=True, eq=False)
class _KeyPoints:
    """px: (n, 2) float64. tile: (n,) int64, number of the tile. descriptor: (n, 128) float32, whole numbers."""

    px: FloatArray
    tile: IdArray
    descriptor: FloatArray

    def __getitem__(self, keep: BoolArray) -> _KeyPoints:
        return _KeyPoints(self.px[keep], self.tile[keep], self.descriptor[keep])


@dataclass(frozen=True, eq=False)
class _GroundMatches:
    """Matches of the ground in one image.

    Attributes:
        location: (n,) int64, indices of the reference's points, ascending.
        px: (n, 2) positions in the image.
        ref_H_cur: homography of the ground plane, if any.
        corners: (tiles, 2) int64 corners of the searched tiles.
    """

    location: IdArray
    px: FloatArray
    ref_H_cur: Homography | None
    corners: IdArray


class _TileSift:
    """SIFT of single tiles; recent results, such as those of the previous image, are cached."""

    def __init__(self, size: IdArray, tiles: int) -> None:
        """size: (2,) width and height of a tile, px. tiles: their number."""
        self.size = size
        self._sift = cv2.SIFT.create(nfeatures=_KEY_POINTS // max(1, tiles), edgeThreshold=_EDGE_RATIO)
        self._remembered = lru_cache(maxsize=4 * tiles)(self._detected)

    def key_points(self, image: Gray, valid: BoolArray, tiles: IdArray, corners: IdArray) -> _KeyPoints:
        """Key points of `tiles`, at `corners` (all tiles, 2), that are clear of tile borders and invalid pixels."""
        px, tile, descriptor = [np.empty((0, 2))], [np.empty(0, np.int64)], [np.empty((0, 128), np.float32)]
        for number in tiles:
            (x, y), (width, height) = corners[number], self.size
            cut = np.s_[y : y + height, x : x + width]
            at, reach, described = self._remembered(image[cut].tobytes())
            column, row = np.round(at).astype(np.int64).T
            clear = _room_px(valid[cut])[row, column] >= reach
            px.append(at[clear] + (x, y))
            tile.append(np.full(clear.sum(), number))
            descriptor.append(described[clear])
        return _KeyPoints(np.concatenate(px), np.concatenate(tile), np.concatenate(descriptor))

    def _detected(self, tile: bytes) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Positions (n, 2), px, required clearances (n,), px, and descriptors (n, 128)."""
        return _sift(self._sift, np.frombuffer(tile, np.uint8).reshape(self.size[::-1]))


def _sift(sift: cv2.SIFT, gray: Gray) -> tuple[FloatArray, FloatArray, FloatArray]:
    points, descriptor = sift.detectAndCompute(gray, None)
    if not points:
        return np.empty((0, 2)), np.empty(0), np.empty((0, 128), np.float32)
    return np.array([p.pt for p in points]), np.array([p.size for p in points]) + _BORDER_PX, descriptor


def _room_px(valid: BoolArray) -> FloatArray:
    """Distance (h, w), px, of each pixel of a tile from the tile's border and from invalid pixels."""
    framed = np.pad(valid, 1).astype(np.uint8)
    return np.asarray(cv2.distanceTransform(framed, cv2.DIST_L2, cv2.DIST_MASK_PRECISE))[1:-1, 1:-1]


def _matches(ones: _KeyPoints, others: _KeyPoints, tiles: IdArray) -> tuple[IdArray, IdArray]:
    """Indices (n,) into both sets of the mutual matches within each tile that pass the ratio test."""
    found = [(np.empty(0, np.int64), np.empty(0, np.int64))]
    for tile in tiles:
        i, j = np.flatnonzero(ones.tile == tile), np.flatnonzero(others.tile == tile)
        a, b = _mutual_nearest(ones.descriptor[i], others.descriptor[j])
        found.append((i[a], j[b]))
    one, other = zip(*found, strict=True)
    return np.concatenate(one), np.concatenate(other)


def _mutual_nearest(ones: FloatArray, others: FloatArray) -> tuple[IdArray, IdArray]:
    # whole numbers up to 128 * 255^2 < 2^24: exact in float32, however the sum is ordered
    squares = [np.sum(d * d, axis=1) for d in (ones, others)]
    distance2 = squares[0][:, None] + squares[1] - 2 * (ones @ others.T)
    one, other = np.nonzero(_passes_ratio_test(distance2) & _passes_ratio_test(distance2.T).T)
    return one, other


def _passes_ratio_test(distance2: FloatArray) -> BoolArray:
    """(n, m) bool: the smallest of its row, if it passes the ratio test (Lowe 2004, section 7.1)."""
    if 0 in distance2.shape:
        return np.zeros(distance2.shape, bool)
    padded = np.pad(distance2, ((0, 0), (0, 1)), constant_values=np.inf)  # a row may have no second
    best, second = np.partition(padded, 1, axis=1)[:, :2].T
    return np.asarray((distance2 == best[:, None]) & (best < _RATIO**2 * second)[:, None])


def _ground(current_px: FloatArray, reference_px: FloatArray, shape: tuple[int, ...],
            fixed_H_ref: Homography | None) -> tuple[Homography | None, BoolArray]:
    """As `_plane`, but what stays in place in the camera while the rest moves is an overlay or dirt, and no ground."""
    if fixed_H_ref is not None:
        moves = ~in_place(reference_px, current_px, fixed_H_ref, _GATE_PX)
        if (~moves).sum() >= _MIN_POINTS:
            H, agrees = _plane(current_px[moves], reference_px[moves], shape)
            if agrees.sum() >= _SUFFICIENT_POINTS:
                return H, _among(moves, agrees)
    return _plane(current_px, reference_px, shape)


def _among(which: BoolArray, agrees: BoolArray) -> BoolArray:
    """(n,) bool from one for each of those in `which`, (n,) bool."""
    found = np.zeros_like(which)
    found[which] = agrees
    return found


def _plane(current_px: FloatArray, reference_px: FloatArray, shape: tuple[int, ...],
           gate_px: float = _GATE_PX) -> tuple[Homography | None, BoolArray]:
    """Homography of the ground, if plausible, and its inliers (n,) bool among the pairs (n, 2).

    Ground surrounds the water. Of the two largest consensus sets, the one with the larger spatial extent is ground,
    unless it is much smaller. The number of points alone is not sufficient where half of the image is water that keeps
    its texture. If one of them stands still in the picture and the other does not, one may be an overlay on all of it:
    then ground is what is seen over the larger area, however many points the text has.
    """
    H, agrees = _consensus(current_px, reference_px, shape, gate_px)
    rest = np.flatnonzero(~agrees)
    if H is None or len(rest) < min(agrees.sum() / _SIZE_RATIO, _SUFFICIENT_POINTS):
        return H, agrees
    other_H, others = _consensus(current_px[rest], reference_px[rest], shape, gate_px)
    other = _among(~agrees, others)
    if _one_is_an_overlay(current_px, reference_px, agrees, other):
        return max((H, agrees), (other_H, other), key=lambda one: _area(reference_px[one[1]]))
    if (other.sum() * _SIZE_RATIO < agrees.sum()
            or _spatial_extent(reference_px[other]) <= _spatial_extent(reference_px[agrees])):
        return H, agrees
    return other_H, other


def _consensus(current_px: FloatArray, reference_px: FloatArray, shape: tuple[int, ...],
               gate_px: float) -> tuple[Homography | None, BoolArray]:
    """Homography and inliers by OpenCV's LO-RANSAC (Chum et al. 2003), which is deterministic."""
    nothing = None, np.zeros(len(current_px), bool)
    if len(current_px) < _MIN_POINTS:
        return nothing
    H, _ = cv2.findHomography(current_px, reference_px, cv2.USAC_DEFAULT, gate_px / 4, None, 5000, 0.9999)
    if H is None or not is_plausible(H, (shape[1], shape[0])):
        return nothing
    return H, np.hypot(*(apply(H, current_px) - reference_px).T) < gate_px


def _spatial_extent(px: FloatArray) -> float:
    """Number of points times the area of their covariance ellipse, px^2."""
    return len(px) * _area(px)


def _area(px: FloatArray) -> float:
    """Of the covariance ellipse of points, px^2."""
    return float(np.sqrt(max(0.0, np.linalg.det(np.cov(px.T)))))


def _one_is_an_overlay(current_px: FloatArray, reference_px: FloatArray, one: BoolArray, other: BoolArray) -> bool:
    """Whether of two large groups of pairs one stands still in the picture, and the other has moved."""
    if min(one.sum(), other.sum()) < _SUFFICIENT_POINTS:
        return False
    moved_px = np.hypot(*(current_px - reference_px).T)
    still, moved = sorted((float(np.median(moved_px[one])), float(np.median(moved_px[other]))))
    return still < _AT_REST_PX and moved > MOVED_PX


class _CoarseSift:
    """SIFT on reduced images: a coarse homography for an image with a large displacement."""

    def __init__(self, reference: Gray) -> None:
        self._level = max(0, int(np.ceil(np.log2(reference.size / _AREA_PX) / 2)))
        self._sift = cv2.SIFT.create(nfeatures=_KEY_POINTS)
        self._px, _, self._descriptor = self._detect(reference)

    def ref_H_cur(self, image: Gray) -> Homography | None:
        """`ref_H_cur`, accurate to a few px; None with too few inliers."""
        px, _, descriptor = self._detect(image)
        i, j = _mutual_nearest(self._descriptor, descriptor)
        H, agrees = _plane(px[j], self._px[i], image.shape, 2.0 ** (self._level + 1))
        return H if agrees.sum() >= _MIN_POINTS else None

    def _detect(self, gray: Gray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Positions in full-resolution px, clearances and descriptors; incomplete blocks at the border are left out."""
        block = 2**self._level
        height, width = gray.shape[0] // block, gray.shape[1] // block
        small = cv2.resize(gray[: height * block, : width * block], (width, height), interpolation=cv2.INTER_AREA)
        px, reach, descriptor = _sift(self._sift, small)
        return apply(np.linalg.inv(level_scale(self._level)), px), reach, descriptor


def _chosen_tiles(reference: Gray, allowed: BoolArray) -> tuple[IdArray, IdArray]:
    """Corners (tiles, 2) and size (2,) of the tiles: the best-textured one per cell of a grid, or the whole image."""
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
    """Texture of the allowed part of a tile, for each position of its corner; 0 where too little is allowed."""
    corner = np.sqrt(np.maximum(cv2.cornerMinEigenVal(reference, 5), 0)) * allowed
    corner = np.minimum(corner, np.percentile(corner[::4, ::4], 95))  # limits the influence of a few strong corners
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
