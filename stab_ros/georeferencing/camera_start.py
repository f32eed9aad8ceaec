"""Where a camera may be, from its control points alone: poses of three points each, for a range of focal lengths."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Iterator

import cv2
import numpy as np

from stab_ros.core.types import FloatArray, IdArray
from stab_ros.georeferencing.camera_problem import Unknowns
from stab_ros.georeferencing.control_points import ControlPoints
from stab_ros.georeferencing.robust_fit import fitting, trimmed
from stab_ros.imaging.camera import Camera
from stab_ros.imaging.pose import Pose
from stab_ros.imaging.view import View

FOCALS = np.geomspace(0.3, 10, 14)  # widths of the image: fields of view of 118 to 6 degrees
_MOST_TRIPLES = 60
_MOST_STARTS = 8
_APART = 0.1  # distance of directions and, as a share of the distance of the points, of places of different starts


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
    views = [View(one, pose) for one in tried for pose in _poses(points, one, position_m)]
    if not views:
        return []
    kept = fitting(len(points), len(unknowns.names))
    scores = np.array([trimmed(_errors2(points, view), kept) for view in views])
    return _different([views[i] for i in np.argsort(scores, kind="stable")], points, most)


def _of_focal(camera: Camera, focal_px: float) -> Camera:
    K = camera.K.copy()
    K[0, 0], K[1, 1] = focal_px, focal_px * camera.K[1, 1] / camera.K[0, 0]
    return dataclasses.replace(camera, K=K)


def _errors2(points: ControlPoints, view: View) -> FloatArray:
    """(N,), squared distances, px^2; infinite behind the camera."""
    in_camera = view.pose.to_camera(points.map_m)
    depth = in_camera[:, 2:]
    rays = in_camera[:, :2] / np.where(depth > 0, depth, np.nan)
    # the image plane of a pinhole, on which rays of a lens were put beforehand, is cheap
    errors = (rays - view.camera.rays(points.image_px)) * view.camera.K[0, 0]
    return np.asarray(np.nan_to_num(np.sum(errors**2, axis=1), nan=np.inf))


def _poses(points: ControlPoints, camera: Camera, position_m: FloatArray | None) -> Iterator[Pose]:
    rays = camera.rays(points.image_px)
    seen = np.flatnonzero(np.isfinite(rays).all(axis=1))
    for chosen in _triples(seen):
        if position_m is None:
            yield from _of_three(points.map_m[chosen], rays[chosen])
        else:
            yield _turned(points.map_m[chosen], rays[chosen], position_m)


def _triples(of: IdArray) -> list[IdArray]:
    """All, or a fixed random choice of, three points."""
    found = [np.array(three) for three in itertools.combinations(of.tolist(), 3)]
    if len(found) <= _MOST_TRIPLES:
        return found
    chosen = np.random.default_rng(0).choice(len(found), _MOST_TRIPLES, replace=False)
    return [found[i] for i in chosen]


def _of_three(map_m: FloatArray, rays: FloatArray) -> Iterator[Pose]:
    """Up to four poses from which three points are seen along these rays (Ke and Roumeliotis 2017, in OpenCV)."""
    centre = map_m.mean(axis=0)
    count, turns, shifts = cv2.solveP3P(map_m - centre, rays, np.eye(3), None, flags=cv2.SOLVEPNP_AP3P)
    for turn, shift in zip(turns[:count], shifts[:count], strict=True):
        R = cv2.Rodrigues(turn)[0]
        position = centre - R.T @ shift.ravel()
        if np.isfinite(position).all() and np.isfinite(R).all():
            yield Pose(position, R)


def _turned(map_m: FloatArray, rays: FloatArray, position_m: FloatArray) -> Pose:
    """The attitude that turns directions of the map to those of the rays (Kabsch 1976)."""
    there, here = map_m - position_m, np.column_stack([rays, np.ones(len(rays))])
    there, here = (v / np.maximum(np.linalg.norm(v, axis=1, keepdims=True), 1e-12) for v in (there, here))
    U, _, Vt = np.linalg.svd(here.T @ there)
    return Pose(position_m, U @ np.diag([1, 1, np.linalg.det(U @ Vt)]) @ Vt)


def _different(views: list[View], points: ControlPoints, most: int) -> list[View]:
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
