"""Where a camera may be, from its control points alone: poses of three points each, for a range of focal lengths."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Iterable, Iterator
from typing import TypeAlias

import cv2
import numpy as np

from stab_ros.core.types import FloatArray, IdArray
from stab_ros.georeferencing.camera_problem import Unknowns
from stab_ros.georeferencing.control_points import ControlPoints
from stab_ros.georeferencing.robust_fit import fitting
from stab_ros.imaging.camera import Camera
from stab_ros.imaging.pose import Pose
from stab_ros.imaging.view import View

FOCALS = np.geomspace(0.3, 10, 14)  # widths of the image: fields of view of 118 to 6 degrees
_MOST_TRIPLES = 40
_MOST_STARTS = 8
_APART = 0.1  # distance of directions and, as a share of the distance of the points, of places of different starts

_Pose: TypeAlias = tuple[FloatArray, FloatArray]  # place (3,), m, and cam_R_map (3, 3)
_Scored: TypeAlias = tuple[float, Camera, FloatArray, FloatArray]


def nominal_camera(size: tuple[int, int], focal_px: float | None = None) -> Camera:
    """A pinhole camera with its principal point in the middle of the image.

    Args:
        size: width and height, px.
        focal_px: focal length; None: the width of the image.
    """
    f = float(size[0] if focal_px is None else focal_px)
    K = np.array([[f, 0, (size[0] - 1) / 2], [0, f, (size[1] - 1) / 2], [0, 0, 1]])
    return Camera(K, np.zeros(5), "plumb_bob", size)


def starts(points: ControlPoints, camera: Camera, unknowns: Unknowns, position_m: FloatArray | None,
           most: int = _MOST_STARTS) -> list[View]:
    """Views to begin a fit from, the best first.

    They are judged by the residuals of those points that fit best, so that some wrong points do no harm (least trimmed
    squares: Rousseeuw and Leroy 1987).

    Args:
        points: control points, of which `kept` are needed.
        camera: what is known of it.
        unknowns: of the fit.
        position_m: (3,), where the camera is; None: not known.
        most: number of views.
    """
    tried = [camera] if unknowns.focals == 0 else [_of_focal(camera, f * camera.size[0]) for f in FOCALS]
    found = [scored for one in tried for scored in _scored(points, one, position_m, len(unknowns.names))]
    found.sort(key=lambda scored: scored[0])
    return _different((View(one, Pose(place, R)) for _, one, place, R in found), points, most)


def _scored(points: ControlPoints, camera: Camera, position_m: FloatArray | None, parameters: int) -> list[_Scored]:
    """Poses of a camera, each with its score: px^2."""
    rays = camera.rays(points.image_px)
    poses = list(_poses(points.map_m, rays, position_m))
    if not poses:
        return []
    places, turns = np.array([place for place, _ in poses]), np.array([R for _, R in poses])
    in_camera = np.einsum("pij,pnj->pni", turns, points.map_m - places[:, None])
    depth = np.where(in_camera[:, :, 2:] > 0, in_camera[:, :, 2:], np.nan)
    errors2 = np.sum((in_camera[:, :, :2] / depth - rays) ** 2, axis=2) * camera.K[0, 0] ** 2  # of a pinhole: cheap
    kept = fitting(len(points), parameters)
    scores = np.partition(np.nan_to_num(errors2, nan=np.inf), kept - 1, axis=1)[:, :kept].sum(axis=1)
    return [(float(score), camera, place, R) for score, place, R in zip(scores, places, turns, strict=True)
            if np.isfinite(score)]


def _of_focal(camera: Camera, focal_px: float) -> Camera:
    K = camera.K.copy()
    K[0, 0], K[1, 1] = focal_px, focal_px * camera.K[1, 1] / camera.K[0, 0]
    return dataclasses.replace(camera, K=K)


def _poses(map_m: FloatArray, rays: FloatArray, position_m: FloatArray | None) -> Iterator[_Pose]:
    for chosen in _triples(np.flatnonzero(np.isfinite(rays).all(axis=1))):
        if position_m is None:
            yield from _of_three(map_m[chosen], rays[chosen])
        else:
            yield position_m, _turned(map_m[chosen], rays[chosen], position_m)


def _triples(of: IdArray) -> list[IdArray]:
    """All, or a fixed random choice of, three points."""
    if math.comb(len(of), 3) <= _MOST_TRIPLES:
        return [np.array(three) for three in itertools.combinations(of.tolist(), 3)]
    rng = np.random.default_rng(0)
    return [rng.choice(of, 3, replace=False) for _ in range(_MOST_TRIPLES)]


def _of_three(map_m: FloatArray, rays: FloatArray) -> Iterator[_Pose]:
    """Up to four poses from which three points are seen along these rays (Ke and Roumeliotis 2017, in OpenCV)."""
    centre = map_m.mean(axis=0)
    count, turns, shifts = cv2.solveP3P(map_m - centre, rays, np.eye(3), None, flags=cv2.SOLVEPNP_AP3P)
    for turn, shift in zip(turns[:count], shifts[:count], strict=True):
        R = cv2.Rodrigues(turn)[0]
        position = centre - R.T @ shift.ravel()
        if np.isfinite(position).all() and np.isfinite(R).all():
            yield position, R


def _turned(map_m: FloatArray, rays: FloatArray, position_m: FloatArray) -> FloatArray:
    """The attitude that turns directions of the map to those of the rays (Kabsch 1976)."""
    there, here = map_m - position_m, np.column_stack([rays, np.ones(len(rays))])
    there, here = (v / np.maximum(np.linalg.norm(v, axis=1, keepdims=True), 1e-12) for v in (there, here))
    U, _, Vt = np.linalg.svd(here.T @ there)
    return np.asarray(U @ np.diag([1, 1, np.linalg.det(U @ Vt)]) @ Vt)


def _different(views: Iterable[View], points: ControlPoints, most: int) -> list[View]:
    found: list[View] = []
    for view in views:
        if not any(_alike(view, other, points) for other in found):
            found.append(view)
        if len(found) == most:
            break
    return found


def _alike(a: View, b: View, points: ControlPoints) -> bool:
    distance = float(np.linalg.norm(a.pose.position_m - points.map_m.mean(axis=0)))
    near = np.linalg.norm(a.pose.position_m - b.pose.position_m) < _APART * distance
    turned = np.linalg.norm(a.pose.cam_R_map - b.pose.cam_R_map) < _APART
    return bool(near and turned)
