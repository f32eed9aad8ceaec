"""The grid of the water plane on which pictures are correlated: square pixels, however the camera looked and moved."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from stab_ros.core.errors import InputError
from stab_ros.core.geometry import apply, inside, normalized
from stab_ros.core.types import BoolArray, FloatArray, Gray, Homography
from stab_ros.georeferencing.horizon import gsd_m, in_front, sampled_pixels, shown_well
from stab_ros.georeferencing.ortho_grid import OrthoGrid
from stab_ros.georeferencing.orthophoto import Orthophotos
from stab_ros.imaging.camera import Camera
from stab_ros.velocimetry.placed_frame import PlacedFrame
from stab_ros.velocimetry.vectors import Unit

MOST_PIXELS = 2_200_000  # of a grid whose resolution nobody gave: one of 1080p
_FLIP = np.diag([1.0, -1.0, 1.0])


@dataclass(frozen=True, eq=False)
class Plane:
    """A grid on the plane.

    Attributes:
        grid: its places; of a plane in pixels with y upwards.
        plane_H_grid: (3, 3), from pixels of the grid to the plane.
    """

    grid: OrthoGrid
    plane_H_grid: Homography

    @staticmethod
    def seen_by(frame: PlacedFrame, unit: Unit, resolution: float, water: Sequence[FloatArray],
                margin_px: float) -> Plane:
        """The grid that covers what a frame shows well of the plane.

        Args:
            frame: the first one.
            unit: of the plane; with "px" its y goes downwards.
            resolution: side of a pixel of the grid; 0: the median ground sampling distance, coarser for a grid of more
                than `MOST_PIXELS`.
            water: polygons (n, 2) on the plane, which bound the grid; none: all is covered.
            margin_px: width by which the grid exceeds them.

        Raises:
            InputError: the frame shows nothing of the plane, or nothing within the polygons.
        """
        up = _FLIP if unit == "px" else np.eye(3)
        H = up @ frame.plane_H_image
        pixels = shown_well(H, sampled_pixels(camera_of(frame)))
        if not len(pixels):
            raise InputError("the frame shows nothing of the water plane, check its homography")
        outline = apply(H, pixels)
        polygons = [apply(up, polygon) for polygon in water]
        side = resolution or max(float(np.median(gsd_m(H, pixels))), _coarse_enough(_within(outline, polygons, 0.0)))
        grid = OrthoGrid.covering(_within(outline, polygons, margin_px * side), side)
        return Plane(grid, up @ grid.map_H_ortho)

    def to_plane(self, pixels: FloatArray) -> FloatArray:
        """Places (N, 2) on the plane of pixels (N, 2) of the grid."""
        return apply(self.plane_H_grid, pixels)

    def velocity(self, shift_px: FloatArray) -> FloatArray:
        """(..., 2) in units of the plane, of displacements (..., 2) in pixels of the grid."""
        return np.asarray(shift_px @ self.plane_H_grid[:2, :2].T)


class PlanePictures:
    """Maps frames to the grid, and tells which of its parts they show."""

    def __init__(self, plane: Plane, interpolation: str) -> None:
        """interpolation: as of orthophotos."""
        self._plane, self._interpolation = plane, interpolation
        self._camera: Camera | None = None
        self._orthophotos: Orthophotos | None = None

    def make(self, frame: PlacedFrame) -> Gray:
        """The frame on the grid, (rows, columns) uint8; 0 where it shows nothing."""
        if self._orthophotos is None or self._camera is not frame.camera:
            self._camera, self._orthophotos = frame.camera, Orthophotos(camera_of(frame), self._interpolation)
        H = normalized(np.linalg.inv(self._plane.plane_H_grid) @ frame.plane_H_image)
        return self._orthophotos.make(frame.gray, H, self._plane.grid.size)

    def shows(self, frame: PlacedFrame, centres_px: FloatArray, reach_px: float) -> BoolArray:
        """(N,) bool: whether the frame shows all of the squares with these centres and half sides."""
        corners = reach_px * np.array([[-1.0, -1], [1, -1], [1, 1], [-1, 1]])
        places = (centres_px[:, None] + corners).reshape(-1, 2)
        pixels = apply(np.linalg.inv(frame.plane_H_image), self._plane.to_plane(places))
        H = (_FLIP if self._plane.plane_H_grid[1, 1] > 0 else np.eye(3)) @ frame.plane_H_image
        seen = inside(places, self._plane.grid.size) & in_front(H, pixels) & _taken(frame, pixels)
        return np.asarray(seen.reshape(-1, len(corners)).all(axis=1))


def camera_of(frame: PlacedFrame) -> Camera:
    """The camera of a frame; one without distortion if it has none."""
    return frame.camera or Camera(np.eye(3), np.zeros(0), "plumb_bob", (frame.gray.shape[1], frame.gray.shape[0]))


def _taken(frame: PlacedFrame, pixels: FloatArray) -> BoolArray:
    """(N,) bool: which undistorted pixels (N, 2) the picture as taken has, with a pixel to spare."""
    camera = camera_of(frame)
    seen = camera.pixels((pixels - camera.K[:2, 2]) @ np.linalg.inv(camera.K[:2, :2]).T)
    return inside(seen - 1, (camera.size[0] - 2, camera.size[1] - 2))  # NaN compares false


def _within(outline: FloatArray, polygons: Sequence[FloatArray], margin: float) -> FloatArray:
    """Corners of the box that holds the outline, and of that no more than the polygons with a margin."""
    low, high = outline.min(axis=0), outline.max(axis=0)
    if polygons:
        corners = np.concatenate(polygons)
        low, high = np.maximum(low, corners.min(axis=0) - margin), np.minimum(high, corners.max(axis=0) + margin)
    if not (low < high).all():
        raise InputError("the polygons of the water lie outside what the first frame shows, check their coordinates")
    return np.stack([low, high])


def _coarse_enough(outline: FloatArray) -> float:
    width, height = outline.max(axis=0) - outline.min(axis=0)
    return float(np.sqrt(width * height / MOST_PIXELS))


def in_polygons(places: FloatArray, polygons: Sequence[FloatArray]) -> BoolArray:
    """(N,) bool: which places (N, 2) lie in one of the polygons; all if there are none."""
    if not polygons:
        return np.ones(len(places), bool)
    origin = places.mean(axis=0) if len(places) else np.zeros(2)  # OpenCV tests in float32
    outlines = [np.asarray(polygon - origin, np.float32) for polygon in polygons]
    return np.array([any(cv2.pointPolygonTest(outline, tuple(map(float, place - origin)), False) >= 0
                         for outline in outlines) for place in places], bool)
