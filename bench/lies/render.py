"""Pictures of a flight and the true motion; nothing here is shared with the renderer of the package."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lies.draw import Recipe
from lies.encoding import encoded
from lies.faults import fault
from lies.garbage import decoded, garbage_frames, shown_poses
from lies.light import Light
from lies.motion import RATE_HZ, path
from lies.scene import Scene
from stab_ros.core.types import BoolArray, FloatArray, Gray, Homography

START_NS = 1_000_000_000


@dataclass(frozen=True, eq=False)
class Flight:
    """A rendered flight.

    Attributes:
        recipe: what it was made of.
        pictures: (h, w) uint8 of every frame.
        world_H_cur: (n, 3, 3) float64, from a frame's pixels to the plane.
        garbage: (n,) bool, frames that do not show the plane.
    """

    recipe: Recipe
    pictures: list[Gray]
    world_H_cur: FloatArray
    garbage: BoolArray

    def stamp_ns(self, k: int) -> int:
        """Of frame k."""
        return START_NS + round(k * 1e9 / RATE_HZ)

    def frame_of(self, stamp_ns: int) -> int:
        """The frame of a stamp."""
        return round((stamp_ns - START_NS) * RATE_HZ / 1e9)

    def true_H(self, k: int, reference: int) -> Homography:
        """The true homography from frame k to frame `reference`."""
        return np.asarray(np.linalg.inv(self.world_H_cur[reference]) @ self.world_H_cur[k])


def render(recipe: Recipe) -> Flight:
    """Renders a flight, all of it into memory."""
    scene, light, add_fault, world_H_cur = Scene(recipe), Light(recipe), fault(recipe), path(recipe)
    sensed = [add_fault(light.sensed(scene.picture(H, k), k), k) for k, H in enumerate(world_H_cur)]
    pictures, shown = decoded(recipe, encoded(recipe, sensed, world_H_cur)), shown_poses(recipe)
    pictures = [np.ascontiguousarray(pictures[k]) for k in shown]
    return Flight(recipe, pictures, world_H_cur[shown], garbage_frames(recipe))
