"""Control points of a known view: seen from a drone above a river, with noise."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from stab_ros.core.types import FloatArray
from stab_ros.georeferencing.control_points import ControlPoints
from stab_ros.georeferencing.levels import on_own_level
from stab_ros.imaging.camera import Camera
from stab_ros.imaging.pose import Pose
from stab_ros.imaging.view import View

SIZE = (1920, 1080)


@dataclass(frozen=True)
class Scene:
    """size: of the image, px. pitch_rad: of the view. relief_m: range of the heights. lens: k1."""

    size: tuple[int, int] = SIZE
    pitch_rad: float = 1.0
    relief_m: float = 4.0
    k1: float = 0.0
    height_m: float = 46.0

    @property
    def view(self) -> View:
        width, height = self.size
        K = np.array([[0.78 * width, 0, (width - 1) / 2], [0, 0.78 * width, (height - 1) / 2], [0, 0, 1]])
        camera = Camera(K, np.array([self.k1, 0, 0, 0, 0]), "plumb_bob", self.size)
        return View(camera, Pose.of_angles(np.array([12.0, -31, self.height_m]), 1.2, self.pitch_rad, 0.05))

    def points(self, count: int, noise_px: float, rng: np.random.Generator) -> ControlPoints:
        """Points spread over the image: one in each cell of a grid."""
        image_px = self._spread(count, rng)
        heights = rng.uniform(0, self.relief_m, count)
        map_m = np.column_stack([on_own_level(self.view, image_px, np.column_stack([image_px, heights])), heights])
        names = tuple(f"G{i + 1}" for i in range(count))
        return ControlPoints(names, image_px + rng.normal(0, noise_px, image_px.shape), map_m)

    def _spread(self, count: int, rng: np.random.Generator) -> FloatArray:
        across = math.ceil(math.sqrt(2 * count))
        cells = rng.permutation(across * math.ceil(across / 2))[:count]
        at = np.column_stack([cells % across, cells // across]) + rng.uniform(0.1, 0.9, (count, 2))
        return np.asarray(at / [across, math.ceil(across / 2)] * [self.size[0] - 1, self.size[1] - 1])


def moved(points: ControlPoints, name: str, east_m: float, north_m: float, up_m: float = 0.0) -> ControlPoints:
    """The points, of which one was surveyed wrongly."""
    map_m = points.map_m.copy()
    map_m[points.names.index(name)] += [east_m, north_m, up_m]
    return ControlPoints(points.names, points.image_px, map_m)
