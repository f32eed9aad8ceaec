"""The pixels of control points as a function of the camera's pose, focal lengths and k1."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from stab_ros.core.errors import InputError
from stab_ros.core.types import FloatArray
from stab_ros.georeferencing.control_points import ControlPoints
from stab_ros.imaging.camera import Camera
from stab_ros.imaging.lens_points import seen_rays
from stab_ros.imaging.pose import Pose
from stab_ros.imaging.view import View

_STEP = 1e-6  # of numerical derivatives of the lens
_NEAREST = 1e-9  # depth that stands for points behind the camera, as a share of the largest distance


@dataclass(frozen=True)
class Unknowns:
    """What is fitted beside the attitude, which always is.

    Attributes:
        position: whether the camera's place is fitted.
        focals: number of focal lengths: 0 (known), 1 (fx = fy) or 2.
        k1: whether the first radial coefficient of the lens is fitted.

    Raises:
        InputError: another number of focal lengths.
    """

    position: bool = True
    focals: int = 1
    k1: bool = False

    def __post_init__(self) -> None:
        if self.focals not in (0, 1, 2):
            raise InputError(f"{self.focals} focal lengths, it must be 0 (known), 1 (fx = fy) or 2")

    @property
    def names(self) -> tuple[str, ...]:
        """Of the parameters; angles are small rotations about the axes of the map."""
        place = ("east_m", "north_m", "up_m") if self.position else ()
        focal = ((), ("f_px",), ("fx_px", "fy_px"))[self.focals]
        return (*place, "about_east_rad", "about_north_rad", "about_up_rad", *focal, *(("k1",) if self.k1 else ()))

    @property
    def rotation(self) -> slice:
        """The parameters of the attitude."""
        first = 3 if self.position else 0
        return slice(first, first + 3)

    @property
    def focal(self) -> slice:
        """The parameters of the focal lengths: their logarithms."""
        return slice(self.rotation.stop, self.rotation.stop + self.focals)


@dataclass(frozen=True, eq=False)
class KnownPosition:
    """Where the camera is known to be.

    Attributes:
        position_m: (3,), in the map.
        sigma_m: standard deviation of each coordinate; 0: exact, it is not fitted.

    Raises:
        InputError: not finite.
    """

    position_m: FloatArray
    sigma_m: float = 0.0

    def __post_init__(self) -> None:
        if self.position_m.shape != (3,) or not np.isfinite(self.position_m).all() or not 0 <= self.sigma_m < np.inf:
            raise InputError("a known position must be 3 finite numbers, its standard deviation 0 or above")


@dataclass(frozen=True, eq=False)
class CameraProblem:
    """Fits `MovableProblem`.

    Attributes:
        points: the control points.
        view: the camera as it is, x = 0.
        unknowns: what is fitted. x: position, m; rotation vector w with map_R_cam' = Exp(w) map_R_cam; logarithm of the
            focal lengths; k1.
        known: where the camera is known to be, with a standard deviation above 0; else None.
    """

    points: ControlPoints
    view: View
    unknowns: Unknowns
    known: KnownPosition | None = field(default=None)

    @property
    def observed_px(self) -> FloatArray:
        return self.points.image_px

    @property
    def parameters(self) -> int:
        return len(self.unknowns.names)

    def moved(self, x: FloatArray) -> CameraProblem:
        return dataclasses.replace(self, view=_moved(self.view, self.unknowns, x))

    def zoomed(self, factor: float) -> CameraProblem:
        """The problem with another focal length, which is known, seen from as much farther away."""
        K, centre = self.view.camera.K.copy(), self.points.map_m.mean(axis=0)
        K[[0, 1], [0, 1]] *= factor
        place = self.view.pose.position_m
        place = centre + factor * (place - centre) if self.unknowns.position else place
        view = View(dataclasses.replace(self.view.camera, K=K), Pose(place, self.view.pose.cam_R_map))
        return dataclasses.replace(self, view=view, unknowns=dataclasses.replace(self.unknowns, focals=0))

    def predicted_px(self, x: FloatArray) -> FloatArray:
        view = _moved(self.view, self.unknowns, x)
        return _pixels(view.camera, self._rays(view.pose))

    def jacobian(self, x: FloatArray) -> FloatArray:
        view = _moved(self.view, self.unknowns, x)
        camera, rays = view.camera, self._rays(view.pose)
        by_ray = _by_rays(camera, rays)
        by_place = -self._by_ground(view, by_ray)
        offset = self.points.map_m - view.pose.position_m
        by_turn = by_place @ -_cross(offset) @ _left_jacobian(x[self.unknowns.rotation])
        columns = [by_place] if self.unknowns.position else []
        return np.concatenate([*columns, by_turn, *self._by_intrinsics(camera, rays)], axis=2)

    def ground_jacobian(self) -> FloatArray:
        return self._by_ground(self.view, _by_rays(self.view.camera, self._rays(self.view.pose)))

    def prior(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        if self.known is None:
            return np.zeros(0), np.zeros((0, self.parameters))
        position = self.view.pose.position_m + x[:3]
        return (position - self.known.position_m) / self.known.sigma_m, np.eye(3, self.parameters) / self.known.sigma_m

    @cached_property
    def _nearest_m(self) -> float:
        return _NEAREST * float(np.ptp(self.points.map_m, axis=0).max() + 1)

    def _depth(self, pose: Pose) -> FloatArray:
        return np.maximum(pose.to_camera(self.points.map_m)[:, 2:], self._nearest_m)

    def _rays(self, pose: Pose) -> FloatArray:
        return np.asarray(pose.to_camera(self.points.map_m)[:, :2] / self._depth(pose))

    def _by_ground(self, view: View, by_ray: FloatArray) -> FloatArray:
        rays, depth = self._rays(view.pose), self._depth(view.pose)
        ray_by_camera = np.zeros((len(rays), 2, 3))
        ray_by_camera[:, 0, 0] = ray_by_camera[:, 1, 1] = 1 / depth[:, 0]
        ray_by_camera[:, :, 2] = -rays / depth
        return np.asarray(by_ray @ ray_by_camera @ view.pose.cam_R_map)

    def _by_intrinsics(self, camera: Camera, rays: FloatArray) -> list[FloatArray]:
        columns = []
        if self.unknowns.focals:
            by_log = (_seen(camera, rays) * np.diag(camera.K)[:2])[:, :, None] * np.eye(2)
            columns.append(by_log if self.unknowns.focals == 2 else by_log.sum(axis=2, keepdims=True))
        if self.unknowns.k1:
            more, less = (_pixels(with_k1(camera, step), rays) for step in (_STEP, -_STEP))
            columns.append((more - less)[:, :, None] / (2 * _STEP))
        return columns


def with_k1(camera: Camera, more: float) -> Camera:
    """The camera with its first distortion coefficient increased."""
    D = camera.D.copy() if len(camera.D) else np.zeros(5)
    D[0] += more
    return dataclasses.replace(camera, D=D)


def rotation_of_vector(w: FloatArray) -> FloatArray:
    """Exp(w) (3, 3) of a rotation vector (Rodrigues)."""
    angle = float(np.linalg.norm(w))
    C = _cross(w[None])[0]
    if angle < 1e-9:
        return np.asarray(np.eye(3) + C)
    return np.asarray(np.eye(3) + np.sin(angle) / angle * C + (1 - np.cos(angle)) / angle**2 * C @ C)


def _left_jacobian(w: FloatArray) -> FloatArray:
    """J (3, 3) with Exp(w + dw) = Exp(J dw) Exp(w) (Barfoot 2017, eq. 7.77)."""
    angle = float(np.linalg.norm(w))
    C = _cross(w[None])[0]
    if angle < 1e-6:
        return np.asarray(np.eye(3) + C / 2)
    return np.asarray(np.eye(3) + (1 - np.cos(angle)) / angle**2 * C + (angle - np.sin(angle)) / angle**3 * C @ C)


def _moved(view: View, unknowns: Unknowns, x: FloatArray) -> View:
    pose, camera, K = view.pose, view.camera, view.camera.K.copy()
    position = pose.position_m + x[:3] if unknowns.position else pose.position_m
    K[[0, 1], [0, 1]] *= np.exp(np.clip(x[unknowns.focal], -20, 20)) if unknowns.focals else 1
    camera = dataclasses.replace(camera, K=K) if unknowns.focals else camera
    turned = pose.cam_R_map @ rotation_of_vector(x[unknowns.rotation]).T
    return View(with_k1(camera, float(x[-1])) if unknowns.k1 else camera, Pose(position, _orthonormal(turned)))


def _orthonormal(R: FloatArray) -> FloatArray:
    U, _, Vt = np.linalg.svd(R)
    return np.asarray(U @ Vt)


def _pixels(camera: Camera, rays: FloatArray) -> FloatArray:
    """As `Camera.pixels`, but continued beyond the range of the lens model, for the sake of the optimiser."""
    return np.asarray(_seen(camera, rays) @ camera.K[:2, :2].T + camera.K[:2, 2])


def _seen(camera: Camera, rays: FloatArray) -> FloatArray:
    return seen_rays(rays, camera.D, camera.fisheye) if camera.distorts else rays


def _by_rays(camera: Camera, rays: FloatArray) -> FloatArray:
    """(N, 2, 2) of the pixels by the rays."""
    if not camera.distorts:
        return np.broadcast_to(camera.K[:2, :2], (len(rays), 2, 2))
    ends = [(_pixels(camera, rays + step), _pixels(camera, rays - step)) for step in _STEP * np.eye(2)]
    return np.stack([(more - less) / (2 * _STEP) for more, less in ends], axis=2)


def _cross(v: FloatArray) -> FloatArray:
    """(N, 3, 3) matrices of the cross product with (N, 3)."""
    C = np.zeros((len(v), 3, 3))
    C[:, 2, 1], C[:, 0, 2], C[:, 1, 0] = v.T
    return np.asarray(C - np.swapaxes(C, 1, 2))
