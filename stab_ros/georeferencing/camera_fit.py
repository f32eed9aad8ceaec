"""The fit of a camera to ground control points: pose, focal lengths and k1, as far as they are not known.

Nothing needs to be guessed: poses of three points, over a range of focal lengths, are the starts (`camera_start`), the
best of them are fitted to those points that fit best, points that contradict the others are left out (`wrong_points`),
and what the points do not tell is refused (`observability`).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import cast

import numpy as np

from stab_ros.core.covariance import factor
from stab_ros.core.errors import InputError
from stab_ros.core.geometry import normalized
from stab_ros.core.text import counted
from stab_ros.core.types import BoolArray, FloatArray, Homography
from stab_ros.georeferencing.adjustment import Solution
from stab_ros.georeferencing.camera_problem import CameraProblem, KnownPosition, Unknowns
from stab_ros.georeferencing.camera_start import nominal_camera, starts
from stab_ros.georeferencing.control_points import ControlPoints
from stab_ros.georeferencing.levels import on_own_level
from stab_ros.georeferencing.observability import doubts, refusals, rivals, why_untold
from stab_ros.georeferencing.point_noise import PointNoise
from stab_ros.georeferencing.robust_fit import cleaned, fitted_to_best
from stab_ros.georeferencing.view_derivatives import by_focals, by_pose
from stab_ros.georeferencing.wrong_points import wrong_text
from stab_ros.imaging.camera import Camera
from stab_ros.imaging.view import View


@dataclass(frozen=True, eq=False)
class CameraFit:
    """A camera that was fitted to control points.

    Attributes:
        points: all of them.
        solution: the adjustment.
        wrong: names of points that were left out since they contradict the others, the worst first.
        warnings: what makes the fit doubtful: one line each.
    """

    points: ControlPoints
    solution: Solution[CameraProblem]
    wrong: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()

    @property
    def view(self) -> View:
        """Camera and pose."""
        return self.solution.problem.view

    @property
    def used(self) -> BoolArray:
        """(N,), the points that were used."""
        return self.solution.used

    @property
    def unknowns(self) -> Unknowns:
        """What was fitted."""
        return self.solution.problem.unknowns

    @property
    def covariance(self) -> FloatArray:
        """(n, n), of the parameters `unknowns.names`: m, rad, px."""
        scale = np.ones(self.solution.problem.parameters)
        scale[self.unknowns.focal] = np.diag(self.view.camera.K)[: self.unknowns.focals]
        return np.asarray(scale[:, None] * self.solution.covariance * scale)

    @property
    def sigmas(self) -> dict[str, float]:
        """Standard deviations by the names of the parameters."""
        return dict(zip(self.unknowns.names, np.sqrt(np.diag(self.covariance)).tolist(), strict=True))

    @property
    def pose_covariance(self) -> FloatArray:
        """(6, 6), of east, north, up and rotations about the axes of the map; 0 for a position that is known."""
        pose = np.zeros((6, 6))
        first = 0 if self.unknowns.position else 3
        pose[first:, first:] = self.covariance[: 6 - first, : 6 - first]
        return pose

    @property
    def residuals_px(self) -> FloatArray:
        """(N, 2), observed minus projected, of all points."""
        return self.solution.residuals_px

    @cached_property
    def residuals_m(self) -> FloatArray:
        """(N, 2), east and north: where a point is seen on the level plane through it, less where it is.

        NaN where the ray does not meet that plane.
        """
        return on_own_level(self.view, self.points.image_px, self.points.map_m) - self.points.map_m[:, :2]

    @property
    def rmse_px(self) -> float:
        """Root mean square distance of the used points: sqrt(RSS / N)."""
        return _rms(self.residuals_px[self.used])

    @property
    def rmse_m(self) -> float:
        """Root mean square distance of the used points on the ground."""
        return _rms(self.residuals_m[self.used])

    @property
    def aic(self) -> float:
        """Akaike's information criterion, 2 N ln(RSS / 2 N) + 2 n (as ImGRAFT); -inf for exact points."""
        observations = 2 * int(self.used.sum())
        squares = float(np.sum(self.residuals_px[self.used] ** 2))
        with np.errstate(divide="ignore"):
            return float(observations * np.log(squares / observations) + 2 * self.solution.problem.parameters)

    def map_H_image(self, wse_m: float) -> tuple[Homography, FloatArray]:
        """Homography from undistorted pixels to the water plane, and its covariance.

        Args:
            wse_m: water surface elevation in the map, m.

        Returns:
            (3, 3), h22 = 1, and (8, 8) of h00 .. h21, from pose and focal lengths and their correlation.

        Raises:
            InputError: the camera is not above the water.
        """
        H, spread = self.spread_on(wse_m)
        return H, np.asarray(spread @ spread.T)

    def spread_on(self, wse_m: float) -> tuple[Homography, FloatArray]:
        """`map_H_image`, and changes (8, n) of h00 .. h21 by one standard deviation of each of n independent errors."""
        H, J = normalized(np.linalg.inv(self.view.image_H_map(wse_m))), self.by_parameters(wse_m)
        return H, np.asarray(J @ factor(self.solution.covariance))

    def by_parameters(self, wse_m: float) -> FloatArray:
        """(8, n) of `map_H_image` by the parameters; k1 is no part of it."""
        J = np.zeros((8, self.solution.problem.parameters))
        J[:, : self.unknowns.rotation.stop] = by_pose(self.view, wse_m)[:, 0 if self.unknowns.position else 3:]
        if self.unknowns.focals:
            by_both = by_focals(self.view, wse_m)
            J[:, self.unknowns.focal] = by_both if self.unknowns.focals == 2 else by_both.sum(axis=1, keepdims=True)
        return J


def fit_camera(points: ControlPoints, size: tuple[int, int], unknowns: Unknowns | None = None, *,
               camera: Camera | None = None, noise: PointNoise | None = None, known: KnownPosition | None = None,
               near: View | None = None) -> CameraFit:
    """Fits pose, focal length and, on request, k1.

    Args:
        points: at least 6, off one plane; 4 where the position is known.
        size: width and height of the image, px.
        unknowns: what is fitted; by default pose and one focal length.
        camera: principal point and distortion, where they are known; by default the middle of the image, and none.
        noise: of the points; by default the residuals tell it.
        known: where the camera is known to be.
        near: a view near the solution, as that of the last frame; by default it is sought.

    Raises:
        InputError: the points do not tell what is asked.
    """
    unknowns = Unknowns() if unknowns is None else unknowns
    return _fit(points, camera or nominal_camera(size), unknowns, noise or PointNoise(), known, near)


def fit_pose(points: ControlPoints, camera: Camera, *, noise: PointNoise | None = None,
             known: KnownPosition | None = None, near: View | None = None) -> CameraFit:
    """Fits the pose of a known camera.

    Args:
        points: at least 3; with 3, several poses may fit, which is refused without `near` or `known`.
        camera: as calibrated.
        noise: of the points; by default the residuals tell it.
        known: where the camera is known to be.
        near: a view near the solution, as that of the last frame; by default it is sought.

    Raises:
        InputError: the points do not tell the pose.
    """
    return _fit(points, camera, Unknowns(focals=0), noise or PointNoise(), known, near)


def _fit(points: ControlPoints, camera: Camera, unknowns: Unknowns, noise: PointNoise, known: KnownPosition | None,
         near: View | None) -> CameraFit:
    fixed = known is not None and known.sigma_m == 0
    unknowns = Unknowns(unknowns.position and not fixed, unknowns.focals, unknowns.k1)
    _check_count(len(points), unknowns)
    begun = [near] if near is not None else starts(points, camera, unknowns, known.position_m if known else None)
    if not begun:
        raise InputError(f"no camera sees the control points so{why_untold(points)}; they must not lie on a line, and "
                         "pixels and places must belong together")
    prior = known if known is not None and not fixed else None
    best = fitted_to_best((CameraProblem(points, view, unknowns, prior) for view in begun), noise)
    found = cleaned(best[0], noise)
    solution = cast("Solution[CameraProblem]", found.solution)
    _check_told(points, solution, best[1:])
    return CameraFit(points, solution, tuple(points.names[i] for i in found.wrong),
                     (*wrong_text(points.names, found), *doubts(solution, points.names)))


def _check_told(points: ControlPoints, best: Solution[CameraProblem], others: list[Solution[CameraProblem]]) -> None:
    refused = refusals(best)
    if refused:
        raise InputError(refused[0] + why_untold(points))
    alike = rivals(best, others)
    if alike:
        places = " and ".join(f"({e:.2f}, {n:.2f}, {u:.2f})" for e, n, u in
                              (view.pose.position_m for view in (best.problem.view, *alike)))
        raise InputError(f"the points fit cameras at {places} m equally well (mirror solutions): add a point, best off "
                         "the plane of the others, or fit the camera by stab-ros camera with its --position")


def _check_count(count: int, unknowns: Unknowns) -> None:
    if unknowns.focals:
        least, what = (6, "pose and focal length") if unknowns.position else (4, "attitude and focal length")
    else:
        least, what = 3, "the pose of a known camera"
    if count < least:
        raise InputError(f"{counted(count, 'control point')}, there must be at least {least} for {what}")


def _rms(errors: FloatArray) -> float:
    squared = np.sum(errors**2, axis=1)
    finite = np.isfinite(squared)
    return float(np.sqrt(squared[finite].mean())) if finite.any() else float("nan")
