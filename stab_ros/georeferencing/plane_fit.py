"""The homography from the image to the water plane, from control points on the plane, without a camera model."""

from __future__ import annotations

import dataclasses
import itertools
from dataclasses import dataclass
from functools import cached_property
from typing import cast

import numpy as np

from stab_ros.core.errors import InputError
from stab_ros.core.geometry import apply, jacobian, normalized, point_jacobian
from stab_ros.core.text import counted
from stab_ros.core.types import BoolArray, FloatArray, Homography
from stab_ros.georeferencing.adjustment import Solution
from stab_ros.georeferencing.control_points import ControlPoints
from stab_ros.georeferencing.point_noise import LEAST_NOISE_PX, PointNoise
from stab_ros.georeferencing.robust_fit import cleaned, fitted_to_best
from stab_ros.georeferencing.wrong_points import wrong_text
from stab_ros.imaging.camera import Camera

LEAST_POINTS = 4
_MOST_STARTS = 40
_MOST_LISTED = 1000
_REFUSED, _DOUBTED = 0.1, 0.03  # uncertainty of places, as a share of the extent of the points
_OFF_PLANE = 0.005  # height above the plane, as a share of that extent, that moves places noticeably
_SINGULAR = 1e6  # condition of four points of which three lie on a line


@dataclass(frozen=True, eq=False)
class PlaneProblem:
    """Fits `MovableProblem`: pixels of places on the plane, by the 8 entries of a homography.

    Attributes:
        points: their pixels are undistorted ones.
        image_H_map: (3, 3), h22 = 1, between coordinates that both are scaled to about 1.
        pixel_H_scaled: (3, 3), from scaled image coordinates to pixels.
        scaled_H_map: (3, 3), from east and north to scaled ones.
    """

    points: ControlPoints
    image_H_map: Homography
    pixel_H_scaled: Homography
    scaled_H_map: Homography

    @property
    def observed_px(self) -> FloatArray:
        return self.points.image_px

    @property
    def parameters(self) -> int:
        return 8

    def moved(self, x: FloatArray) -> PlaneProblem:
        return dataclasses.replace(self, image_H_map=self._at(x))

    def predicted_px(self, x: FloatArray) -> FloatArray:
        return apply(self.pixel_H_scaled @ self._at(x), self._scaled)

    def jacobian(self, x: FloatArray) -> FloatArray:
        return np.asarray(self.pixel_H_scaled[0, 0] * jacobian(self._at(x), self._scaled))

    def ground_jacobian(self) -> FloatArray:
        H = self.pixel_H_scaled @ self.image_H_map @ self.scaled_H_map
        by_place = point_jacobian(H, self.points.map_m[:, :2])
        return np.concatenate([by_place, np.zeros((len(by_place), 2, 1))], axis=2)

    def prior(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        return np.zeros(0), np.zeros((0, len(x)))

    def map_H_image(self, x: FloatArray) -> Homography:
        """(3, 3), h22 = 1, from pixels to east and north."""
        return normalized(np.linalg.inv(self.pixel_H_scaled @ self._at(x) @ self.scaled_H_map))

    def _at(self, x: FloatArray) -> Homography:
        return np.asarray(self.image_H_map + np.append(x, 0).reshape(3, 3))

    @cached_property
    def _scaled(self) -> FloatArray:
        return apply(self.scaled_H_map, self.points.map_m[:, :2])


@dataclass(frozen=True, eq=False)
class PlaneFit:
    """A homography that was fitted to control points on the plane.

    Attributes:
        points: all of them, their pixels as given.
        solution: the adjustment.
        wse_m: height of the plane.
        wrong: names of points that were left out since they contradict the others, the worst first.
        warnings: what makes the fit doubtful: one line each.
    """

    points: ControlPoints
    solution: Solution[PlaneProblem]
    wse_m: float
    wrong: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()

    @property
    def map_H_image(self) -> Homography:
        """(3, 3), h22 = 1, from undistorted pixels to east and north on the plane, m."""
        return self.solution.problem.map_H_image(np.zeros(8))

    @property
    def covariance(self) -> FloatArray:
        """(8, 8), of h00 .. h21 of `map_H_image`."""
        steps = 1e-4 * np.sqrt(np.maximum(np.diag(self.solution.covariance), 1e-30))
        problem = self.solution.problem
        ends = [(problem.map_H_image(step), problem.map_H_image(-step)) for step in np.diag(steps)]
        J = np.stack([(more - less).ravel()[:8] for more, less in ends], axis=1) / (2 * steps)
        return np.asarray(J @ self.solution.covariance @ J.T)

    @property
    def used(self) -> BoolArray:
        """(N,), the points that were used."""
        return self.solution.used

    @property
    def residuals_px(self) -> FloatArray:
        """(N, 2), observed minus projected, undistorted px, of all points."""
        return self.solution.residuals_px

    @property
    def residuals_m(self) -> FloatArray:
        """(N, 2), east and north: where a point is seen on the plane, less where it is."""
        problem = self.solution.problem
        return apply(self.map_H_image, problem.points.image_px) - problem.points.map_m[:, :2]

    @property
    def rmse_px(self) -> float:
        """Root mean square distance of the used points: sqrt(RSS / N)."""
        return _rms(self.residuals_px[self.used])

    @property
    def rmse_m(self) -> float:
        """Root mean square distance of the used points on the plane."""
        return _rms(self.residuals_m[self.used])


def fit_plane(points: ControlPoints, wse_m: float | None = None, *, camera: Camera | None = None,
              noise: PointNoise | None = None) -> PlaneFit:
    """Fits the homography from the image to a level plane.

    Args:
        points: at least 4 on the plane; with 4, no residual tells whether one is wrong.
        wse_m: height of the plane; by default the mean height of the points.
        camera: takes the distortion out of the pixels; by default they are those of a pinhole.
        noise: of the points; by default the residuals tell it.

    Raises:
        InputError: the points do not tell the homography.
    """
    if len(points) < LEAST_POINTS:
        raise InputError(f"{counted(len(points), 'control point')}, there must be at least {LEAST_POINTS} for a "
                         "homography")
    noise = PointNoise() if noise is None else noise
    level = float(points.map_m[:, 2].mean()) if wse_m is None else wse_m
    begun = _starts(_undistorted(points, camera))
    if not begun:
        raise InputError("the control points tell no homography: no three of four of them may lie on a line")
    found = cleaned(fitted_to_best(begun, noise)[0], noise)
    solution = cast("Solution[PlaneProblem]", found.solution)
    _check_told(solution)
    warnings = [*wrong_text(points.names, found), *_doubts(solution, level)]
    return PlaneFit(points, solution, level, tuple(points.names[i] for i in found.wrong), tuple(warnings))


def _check_told(solution: Solution[PlaneProblem]) -> None:
    problem, used = solution.problem, solution.used
    share = _uncertainty(solution)
    if not share < _REFUSED:
        raise InputError(f"the points do not tell the homography (places amid them {100 * min(share, 9.99):.0f} % of "
                         "their extent uncertain): no three of four may lie on a line")
    H = problem.map_H_image(np.zeros(8))
    px = problem.points.image_px[used]
    depth = px @ H[2, :2] + 1
    if depth.max() > 0 > depth.min():
        raise InputError("the horizon would run between the control points: pixels and places do not belong together")
    if np.linalg.det(point_jacobian(H, px)).max() > 0:
        raise InputError("the control points are mirrored: east and north (or latitude and longitude) seem to be "
                         "swapped")


def _doubts(solution: Solution[PlaneProblem], level_m: float) -> list[str]:
    points, found = solution.problem.points, []
    share = _uncertainty(solution)
    if share > _DOUBTED:
        found.append(f"places amid the points are uncertain by {100 * share:.1g} % of their extent: they lie nearly on "
                     "a line")
    off = points.map_m[:, 2] - level_m
    if np.abs(off).max() > _OFF_PLANE * float(np.ptp(points.map_m[:, :2], axis=0).max()):
        found.append(f"control points lie up to {float(off[np.argmax(np.abs(off))]):+.2f} m off the plane at "
                     f"{level_m:.2f} m: without a camera model the plane of the points stands for it")
    if solution.redundancy <= 0:
        found.append("no point is more than needed: nothing checks the fit")
    return found


def _uncertainty(solution: Solution[PlaneProblem]) -> float:
    """Standard deviation of places in the middle of pairs of points, as a share of their extent."""
    problem = solution.problem
    here = problem.points.image_px[solution.used]
    middles = (here[:, None] + here[None]).reshape(-1, 2) / 2
    steps = 1e-4 * np.sqrt(np.maximum(np.diag(solution.cofactors), 1e-30))
    if not np.isfinite(steps).all():
        return np.inf
    ends = [(apply(problem.map_H_image(step), middles), apply(problem.map_H_image(-step), middles))
            for step in np.diag(steps)]
    J = np.stack([(more - less) for more, less in ends], axis=2) / (2 * steps)
    variance = max(solution.covering_variance, 1.0 if solution.noise.image_px else LEAST_NOISE_PX**2)
    sigma = np.sqrt(np.einsum("nij,jk,nik->n", J, solution.cofactors * variance, J))
    return float(sigma.max() / np.ptp(problem.points.map_m[solution.used, :2], axis=0).max())


def _undistorted(points: ControlPoints, camera: Camera | None) -> ControlPoints:
    if camera is None:
        return points
    rays = camera.rays(points.image_px)
    return ControlPoints(points.names, rays @ camera.K[:2, :2].T + camera.K[:2, 2], points.map_m)


def _starts(points: ControlPoints) -> list[PlaneProblem]:
    """Homographies of four points each."""
    scaled_H_map, scaled_H_pixel = _scaling(points.map_m[:, :2]), _scaling(points.image_px)
    there, here = apply(scaled_H_map, points.map_m[:, :2]), apply(scaled_H_pixel, points.image_px)
    found = (_of_four(there[chosen], here[chosen]) for chosen in _fours(len(points)))
    return [PlaneProblem(points, H, np.linalg.inv(scaled_H_pixel), scaled_H_map) for H in found if H is not None]


def _fours(count: int) -> list[list[int]]:
    """All, or a fixed random choice of, four points."""
    found = [list(four) for four in itertools.islice(itertools.combinations(range(count), 4), _MOST_LISTED)]
    if len(found) <= _MOST_STARTS:
        return found
    rng = np.random.default_rng(0)
    return [rng.choice(count, 4, replace=False).tolist() for _ in range(_MOST_STARTS)]


def _of_four(there: FloatArray, here: FloatArray) -> Homography | None:
    """The homography here <- there, (4, 2) each; None where three lie on a line."""
    ones, none = np.ones((4, 1)), np.zeros((4, 3))
    ahead = np.concatenate([there, ones], axis=1)
    A = np.concatenate([np.concatenate([ahead, none, -here[:, :1] * there], axis=1),
                        np.concatenate([none, ahead, -here[:, 1:] * there], axis=1)])
    if np.linalg.cond(A) > _SINGULAR:
        return None
    return np.append(np.linalg.solve(A, here.T.ravel()), 1).reshape(3, 3)


def _scaling(places: FloatArray) -> Homography:
    """Homography that moves the mean to 0 and scales the distance to sqrt(2) (Hartley and Zisserman 2004, 4.4.4)."""
    centre = places.mean(axis=0)
    distance = float(np.sqrt(np.mean(np.sum((places - centre) ** 2, axis=1))))
    k = np.sqrt(2) / max(distance, 1e-12)
    return np.array([[k, 0, -k * centre[0]], [0, k, -k * centre[1]], [0, 0, 1]])


def _rms(errors: FloatArray) -> float:
    return float(np.sqrt(np.mean(np.sum(errors**2, axis=1))))
