"""`dynamic_gcps`: control points followed in every frame, each of which has a pose of its own."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from stab_ros.core.errors import ConfigError, InputError
from stab_ros.core.geometry import normalized
from stab_ros.core.text import are, counted
from stab_ros.core.types import BoolArray, FloatArray, Gray, Homography
from stab_ros.georeferencing.camera_fit import CameraFit, fit_pose
from stab_ros.georeferencing.control_points import ControlPoints
from stab_ros.georeferencing.followed_error import FollowedError, followed_error
from stab_ros.georeferencing.followed_points import PointFollower
from stab_ros.georeferencing.gcp_fit import GcpFit
from stab_ros.georeferencing.orientation import Answer, Unplaced
from stab_ros.georeferencing.placement import Placement, Sighting
from stab_ros.georeferencing.point_noise import PointNoise
from stab_ros.georeferencing.posed import not_above
from stab_ros.georeferencing.settings import GeoreferenceConfig
from stab_ros.georeferencing.stationary_gcps import by_fit
from stab_ros.imaging.view import View

_LEAST_POINTS = 4  # one more than determine a pose, so that a wrong one shows


@dataclass(frozen=True, eq=False)
class _Followed:
    """The fit to the points that are seen in a frame: seen, (N,) bool; tracking_px2, (n, 2, 2), of those n."""

    fit: CameraFit
    seen: BoolArray
    tracking_px2: FloatArray


class DynamicGcps:
    """The points are marked in the first frame; later they are found there where the last pose expects them."""

    needs_motion = False
    needs_sensors = False
    needs_picture = True

    def __init__(self, config: GeoreferenceConfig, found: GcpFit) -> None:
        """Prepares for a stream.

        Args:
            config: the settings.
            found: the fit to the control points of the first frame.

        Raises:
            ConfigError: the points tell a plane only, and the camera is not calibrated.
        """
        if not isinstance(found.fit, CameraFit):
            raise ConfigError("dynamic_gcps needs the calibration of the camera, or 6 control points off one plane "
                              "which tell its focal length")
        self._config, self._found, self._fit = config, found, found.fit
        self._noise = PointNoise(config.gcp_sigma_px, config.gcp_sigma_m)
        self._view = found.fit.view  # of the last placed frame
        self._follower: PointFollower | None = None
        self._trusted = np.isin(found.fit.points.names, found.fit.wrong, invert=True)

    def place(self, sighting: Sighting) -> Answer:
        """Places a frame by the points that it shows."""
        if self._follower is None:
            self._follower = PointFollower(sighting.gray, self._fit.points.image_px, self._config.gcp_patch_px)
            usable = int(np.sum(self._follower.usable & self._trusted))
            if usable < _LEAST_POINTS:
                raise InputError(f"{usable} of {counted(len(self._trusted), 'control point')} {are(usable)} amid "
                                 f"structure to be followed by, it must be {_LEAST_POINTS}; mark others")
            first = by_fit(self._found, sighting.wse_m, sighting.wse_sigma_m)
            return _linked(first, FollowedError.of_marked(self._fit))
        expected = self._follower.moved(sighting.gray, self._view.project(self._fit.points.map_m))
        followed = self._fitted(self._follower, sighting.gray, expected, self._view)
        if isinstance(followed, _Followed) and followed.seen.sum() < self._trusted.sum():
            view = followed.fit.view  # by which hidden points are found
            followed = self._fitted(self._follower, sighting.gray, view.project(self._fit.points.map_m), view)
        if isinstance(followed, Unplaced):
            return followed
        self._view = followed.fit.view
        self._follower.keep(sighting.gray)
        return self._placed(followed, sighting)

    def _fitted(self, follower: PointFollower, gray: Gray, expected_px: FloatArray, near: View) -> _Followed | Unplaced:
        """The pose by the points that are seen near where they are expected."""
        points = self._fit.points
        found = follower.find(gray, expected_px, _moved(self._fit.view, near, self._ground_m))
        seen = found.found & self._trusted
        if seen.sum() < _LEAST_POINTS:
            count = int(seen.sum())
            return Unplaced(f"{count} of {counted(len(points), 'control point')} {are(count)} seen, it must be "
                            f"{_LEAST_POINTS}")
        there = ControlPoints(points.names, np.where(seen[:, None], found.pixels, 0), points.map_m).where(seen)
        try:
            fit = fit_pose(there, self._found.camera, noise=self._noise, near=near)
        except InputError as error:
            return Unplaced(str(error))
        return _Followed(fit, seen, found.covariance_px2[seen])

    def _placed(self, followed: _Followed, sighting: Sighting) -> Answer:
        fit = followed.fit
        if not fit.view.pose.position_m[2] > sighting.wse_m:
            return not_above(fit.view.pose, sighting.wse_m)
        error = followed_error(self._fit, fit, followed.seen, followed.tracking_px2)
        hidden = tuple(name for name in self._fit.points.names if name not in fit.points.names)
        answer = by_fit(GcpFit(fit, self._found.camera, True, self._warnings(hidden, fit)), sighting.wse_m,
                        sighting.wse_sigma_m, error.on_water(sighting.wse_m))
        answer = _linked(answer, error)
        return replace(answer, rejected=(*hidden, *fit.wrong)) if isinstance(answer, Placement) else answer

    def _warnings(self, hidden: tuple[str, ...], fit: CameraFit) -> tuple[str, ...]:
        lost = [name for name in hidden if name not in self._fit.wrong]
        found = (f"not seen: {', '.join(lost)}" if lost else "", *(
            f"control point {name} contradicts the others" for name in fit.wrong))
        return (*self._found.warnings, *filter(None, found))

    @property
    def _ground_m(self) -> float:
        return float(np.median(self._fit.points.map_m[:, 2]))


def _linked(answer: Answer, error: FollowedError) -> Answer:
    """The answer, with what its pose shares with those of other frames."""
    if not isinstance(answer, Placement):
        return answer
    return replace(answer, pose_covariance=error.pose_covariance, pose_link=error.pose_link)


def _moved(first: View, last: View, ground_m: float) -> Homography:
    """Homography from undistorted pixels of the first frame to those of the last one, of the ground."""
    return normalized(last.image_H_map(ground_m) @ np.linalg.inv(first.image_H_map(ground_m)))
