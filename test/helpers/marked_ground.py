"""Pictures of a flat ground with marks at known places in space, through a lens, from known poses of the camera."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from truth import sampled

from stab_ros.core.types import FloatArray, Gray

HEIGHT_M = 20.0  # of the camera above the ground
_RADIUS_PX, _SPOT_PX = 9.0, 2.5  # of a mark in the reference: a dark disc with a bright spot in its middle
_DARK, _BRIGHT = 40.0, 200.0
_QUARTERS = ((-0.25, -0.25), (0.25, -0.25), (-0.25, 0.25), (0.25, 0.25))


@dataclass(frozen=True, eq=False)
class MarkedGround:
    """Seen by a camera with K (3, 3) and D (5,), in OpenCV's plumb_bob, whose pictures have this size.

    marks_px: (n, 2), where a pinhole with K sees the marks from the pose of the reference.
    """

    K: FloatArray
    D: FloatArray
    size: tuple[int, int]
    marks_px: FloatArray

    @property
    def marks_m(self) -> FloatArray:
        """(n, 3): the marks in the frame of the reference's camera, z along its axis."""
        return HEIGHT_M * np.column_stack([self.marks_px, np.ones(len(self.marks_px))]) @ np.linalg.inv(self.K).T

    def taken(self, rotation: FloatArray, place_m: FloatArray) -> Gray:
        """The picture from another pose, in the frame of the reference's camera: each pixel's ray meets the ground."""
        x, y = (one.ravel() for one in np.meshgrid(*(np.arange(float(n)) for n in self.size)))
        looks = [self._ground(self._rays(np.column_stack([x + dx, y + dy])) @ rotation.T, place_m)
                 for dx, dy in _QUARTERS]
        return np.asarray(np.clip(np.round(np.mean(looks, axis=0)), 0, 255), np.uint8).reshape(self.size[::-1])

    def _rays(self, seen_px: FloatArray) -> FloatArray:
        """(n, 3) of pixels (n, 2): OpenCV's projection, inverted by fixed-point iteration."""
        ideal = seen_px
        for _ in range(12):
            rays = np.column_stack([(ideal - self.K[:2, 2]) / self.K[[0, 1], [0, 1]], np.ones(len(seen_px))])
            ideal = ideal + seen_px - cv2.projectPoints(rays, np.zeros(3), np.zeros(3), self.K, self.D)[0][:, 0]
        return rays

    def _ground(self, rays: FloatArray, place_m: FloatArray) -> FloatArray:
        """Grey levels (n,) where rays from a place meet the ground."""
        met_m = place_m + rays * ((HEIGHT_M - place_m[2]) / rays[:, 2])[:, None]
        x, y = (met_m @ self.K.T / HEIGHT_M).T[:2]
        grey = sampled(np.eye(3), x[None], y[None], self.size, 1)[0]
        for u, v in self.marks_px:
            squared = (x - u) ** 2 + (y - v) ** 2
            near = squared < _RADIUS_PX**2
            grey[near] = _DARK + (_BRIGHT - _DARK) * np.exp(-squared[near] / (2 * _SPOT_PX**2))
        return np.asarray(grey)


def spot_px(picture: FloatArray, near_px: FloatArray, radius_px: float) -> FloatArray:
    """The middle (2,) of the spot near a place: the centroid of what is brighter than the disc."""
    y, x = np.mgrid[: picture.shape[0], : picture.shape[1]]
    weight = np.clip(picture - _DARK - 2.0, 0, None) * (np.hypot(x - near_px[0], y - near_px[1]) < radius_px)
    return np.asarray(np.array([np.sum(weight * x), np.sum(weight * y)]) / np.sum(weight))
