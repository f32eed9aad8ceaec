"""Where one frame lies by its ground control points: the fit of a camera, or of a plane where there is none."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stab_ros.core.covariance import factor
from stab_ros.core.errors import InputError
from stab_ros.core.geometry import normalized
from stab_ros.core.types import FloatArray, Homography
from stab_ros.georeferencing.camera_fit import CameraFit, fit_camera, fit_pose
from stab_ros.georeferencing.control_points import ControlPoints
from stab_ros.georeferencing.coordinate_checks import below_points, below_text, fit_as_read
from stab_ros.georeferencing.gcp_places import check_inside
from stab_ros.georeferencing.plane_fit import LEAST_POINTS, PlaneFit, fit_plane
from stab_ros.georeferencing.point_noise import PointNoise
from stab_ros.georeferencing.settings import GeoreferenceConfig
from stab_ros.georeferencing.unit_checks import is_feet
from stab_ros.georeferencing.view_derivatives import by_level
from stab_ros.imaging.camera import Camera
from stab_ros.imaging.pose import Pose

_OFF_PLANE = 0.005  # height of points above the plane, as a share of their extent, that moves the water noticeably
_DISAGREE = 0.05  # relative difference of heights that is warned of


@dataclass(frozen=True, eq=False)
class GcpFit:
    """A fit to control points, of whichever kind.

    Attributes:
        fit: of the camera, or of the plane of the points.
        camera: the one that was fitted, or that was known.
        calibrated: whether its K is known now.
        warnings: what makes it doubtful: one line each.
    """

    fit: CameraFit | PlaneFit
    camera: Camera
    calibrated: bool
    warnings: tuple[str, ...]

    @property
    def values(self) -> dict[str, float]:
        """Figures for the status."""
        return {"rmse_px": self.fit.rmse_px, "rmse_m": self.fit.rmse_m, "gcps": float(len(self.fit.points)),
                "gcps_used": float(self.fit.used.sum())}

    @property
    def pose(self) -> tuple[Pose, FloatArray] | None:
        """Pose and covariance (6, 6); None: the points tell a plane only."""
        return None if isinstance(self.fit, PlaneFit) else (self.fit.view.pose, self.fit.pose_covariance)

    @property
    def focal_spread(self) -> FloatArray:
        """(2, K), what the K errors of `on_plane` change of the logarithms of both focal lengths; (2, 0): known."""
        if isinstance(self.fit, PlaneFit) or not self.fit.unknowns.focals:
            return np.zeros((2, 0))
        rows = factor(self.fit.solution.covariance)[self.fit.unknowns.focal]
        return np.asarray(np.broadcast_to(rows, (2, rows.shape[1])))

    @property
    def worst_point(self) -> str:
        """The used point with the largest residual."""
        size = np.where(self.fit.used, np.linalg.norm(self.fit.residuals_px, axis=1), -1)
        return self.fit.points.names[int(np.argmax(size))]

    def on_plane(self, plane_m: float) -> tuple[Homography, FloatArray]:
        """Homography (3, 3), h22 = 1, from undistorted pixels to a level plane, and its error.

        The error is (8, K), changes of h00 .. h21 by one standard deviation of each of K independent errors.

        That of the points, whatever `plane_m` is, where there is no camera.
        """
        if isinstance(self.fit, PlaneFit):
            return normalized(self.fit.map_H_image), factor(self.fit.covariance)
        return self.fit.spread_on(plane_m)

    def by_level(self, wse_m: float) -> FloatArray:
        """(8,) derivative of `on_plane` by the elevation."""
        return np.zeros(8) if isinstance(self.fit, PlaneFit) else by_level(self.fit.view, wse_m)


def fit_gcps(config: GeoreferenceConfig, camera: Camera, calibrated: bool, gcps: ControlPoints) -> GcpFit:
    """Fits what is not known.

    Args:
        config: the settings.
        camera: that took the image.
        calibrated: whether its K is known; without, it is fitted too if the points tell it, else the plane they lie on.
        gcps: the points, their pixels as taken.

    Raises:
        InputError: a point lies outside the image, the points do not tell where it lies or fit far better if read in
            another way, or the water would be above the camera.
    """
    check_inside(gcps, camera.size)
    fit = fit_as_read(gcps, camera.size, lambda points: _fitted(config, camera, calibrated, points))
    if isinstance(fit, PlaneFit):
        return GcpFit(fit, camera, False, (*fit.warnings, *_off_plane(config, fit)))
    height_m = _height(config, fit)
    below = (below_text(fit),) if below_points(fit) else ()
    return GcpFit(fit, fit.view.camera, True, (*fit.warnings, *below, *_height_warning(config.height_m, height_m)))


def _fitted(config: GeoreferenceConfig, camera: Camera, calibrated: bool, gcps: ControlPoints) -> CameraFit | PlaneFit:
    """The pose, or else the camera, or else the plane of the points."""
    noise = PointNoise(config.gcp_sigma_px, config.gcp_sigma_m)
    if calibrated:
        return fit_pose(gcps, camera, noise=noise)
    try:
        fit = fit_camera(gcps, camera.size, noise=noise)
        _height(config, fit)
    except InputError:
        if len(gcps) < LEAST_POINTS:
            raise
        return fit_plane(gcps, noise=noise)
    return fit


def _off_plane(config: GeoreferenceConfig, plane: PlaneFit) -> tuple[str, ...]:
    """That the plane of the points is not that of the water, if so."""
    off_m = plane.wse_m - config.wse_m
    extent_m = float(np.ptp(plane.points.map_m[:, :2], axis=0).max())
    return () if abs(off_m) < _OFF_PLANE * extent_m else (
        f"the control points lie {off_m:.2f} m above the water, and without the calibration of the camera their plane "
        "stands for it",)


def _height(config: GeoreferenceConfig, fit: CameraFit) -> float:
    """Height of the camera above the water, m; raises InputError where that is above it."""
    height_m = float(fit.view.pose.position_m[2]) - config.wse_m
    if not height_m > 0:
        raise InputError(f"wse_m: the water surface at {config.wse_m:g} m is not below the camera, which the control "
                         f"points place at {height_m + config.wse_m:.2f} m; check that both have one height datum, and "
                         "metres")
    return height_m


def _height_warning(given_m: float, fitted_m: float) -> tuple[str, ...]:
    """What a height that was given tells of the fitted one."""
    if not given_m or abs(fitted_m / given_m - 1) < _DISAGREE:
        return ()
    why = "; one of both is in feet, they must be in metres" if is_feet(fitted_m / given_m) else ""
    return (f"the control points place the camera {fitted_m:.4g} m above the water, height_m {given_m:.4g} m{why}",)

