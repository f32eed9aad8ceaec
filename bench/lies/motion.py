"""The camera's motion as homographies: hovering, drifting, in gusts, with one cut, or none at all."""

from __future__ import annotations

import numpy as np

from lies.draw import Recipe
from stab_ros.core.types import FloatArray, Homography

RATE_HZ = 25.0
_STANDARD_WIDTH = 960.0  # of a picture in which motion is as many px as said below


def path(recipe: Recipe) -> FloatArray:
    """(n, 3, 3): `world_H_cur` of every frame, from its pixels to the plane, whose unit is a px of the picture."""
    rng = np.random.default_rng([recipe.seed, 1])
    poses = np.zeros((recipe.frames, 6)) if recipe.motion == "fixed" else _hover(rng, recipe.frames)
    add = {"drift": _drift, "gusts": _gusts, "cut": _cut}.get(recipe.motion)
    poses = poses if add is None else poses + add(rng, recipe.frames)
    poses[:, :2] *= recipe.size[0] / _STANDARD_WIDTH
    return np.array([_homography(pose, recipe.size) for pose in poses])


def _hover(rng: np.random.Generator, frames: int) -> FloatArray:
    """(n, 6): shifts, px; turn, rad; logarithm of the zoom; two tilts, relative to the width: slow and fast swings."""
    t = np.arange(frames) / RATE_HZ
    limits = np.array([rng.uniform(0.7, 8), rng.uniform(0.7, 8), 0.006, 0.004, 0.006, 0.006]) * rng.uniform(0.5, 1, 6)
    poses = np.zeros((frames, 6))
    for low_hz, high_hz, weight in ((0.1, 0.4, 0.65), (0.4, 1.2, 0.28), (1.5, 4, 0.07)):
        phase = 2 * np.pi * (rng.uniform(low_hz, high_hz, 6) * t[:, None] + rng.uniform(0, 1, 6))
        poses += weight * limits * np.sin(phase)
    return poses


def _drift(rng: np.random.Generator, frames: int) -> FloatArray:
    """Up to three px a frame, with a slow turn and climb, over no more than two fifths of the picture."""
    speed, angle = min(rng.uniform(0.3, 3), 0.4 * _STANDARD_WIDTH / frames), rng.uniform(0, 2 * np.pi)
    rates = [speed * np.cos(angle), 0.6 * speed * np.sin(angle), rng.normal(0, 0.0012), rng.normal(0, 0.0008), 0, 0]
    return np.asarray(np.arange(frames)[:, None] * np.array(rates))


def _gusts(rng: np.random.Generator, frames: int) -> FloatArray:
    """Steps of 5 to 20 px a frame whose direction wanders, drawn back where they lead too far off."""
    poses, angle = np.zeros((frames, 6)), rng.uniform(0, 2 * np.pi)
    turn = 0.0
    for k in range(1, frames):
        place, limit = poses[k - 1, :2], (150.0, 80.0)
        angle += rng.normal(0, 0.5)
        step = rng.uniform(5, 20) * np.array([np.cos(angle), np.sin(angle)])
        outside = (np.abs(place) > limit) & (place * step > 0)
        step = np.where(outside, -step, step)
        angle = float(np.arctan2(step[1], step[0]))
        turn = 0.8 * turn + rng.normal(0, 0.0015)
        poses[k] = [*(place + step), poses[k - 1, 2] + turn, 0.98 * poses[k - 1, 3] + rng.normal(0, 0.0015), 0, 0]
    return poses


def _cut(rng: np.random.Generator, frames: int) -> FloatArray:
    """One jump by 5 to 25 % of the picture, with a turn of up to 8 degrees and a zoom of up to 10 %."""
    poses, at = np.zeros((frames, 6)), int(rng.integers(frames // 4, frames - frames // 6))
    shift, angle = rng.uniform(0.05, 0.25) * _STANDARD_WIDTH, rng.uniform(0, 2 * np.pi)
    poses[at:] = [shift * np.cos(angle), 0.6 * shift * np.sin(angle), *rng.uniform((-0.14, -0.1), (0.14, 0.1)), 0, 0]
    return poses


def _homography(pose: FloatArray, size: tuple[int, int]) -> Homography:
    """Turn, zoom and tilt about the picture's centre, then the shift."""
    x, y, turn, zoom, tilt_x, tilt_y = pose
    centre = np.array([(size[0] - 1) / 2, (size[1] - 1) / 2])
    c, s = np.exp(zoom) * np.cos(turn), np.exp(zoom) * np.sin(turn)
    turned = np.array([[c, -s, centre[0] + x], [s, c, centre[1] + y], [0, 0, 1]])
    tilted = np.array([[1, 0, 0], [0, 1, 0], [tilt_x / size[0], tilt_y / size[0], 1]])
    H = turned @ tilted @ np.array([[1, 0, -centre[0]], [0, 1, -centre[1]], [0, 0, 1]])
    return np.asarray(H / H[2, 2])
