"""`stationary_nadir`: a camera that looks straight down from a known height (Perks 2020, section 2.2.1)."""

from __future__ import annotations

import math

import numpy as np

from stab_ros.core.errors import ConfigError
from stab_ros.georeferencing.control_points import ControlPoints
from stab_ros.georeferencing.nadir_check import doubts_of_nadir, nadir_by_points
from stab_ros.georeferencing.orientation import Answer
from stab_ros.georeferencing.placement import Sighting
from stab_ros.georeferencing.posed import placed
from stab_ros.georeferencing.settings import GeoreferenceConfig
from stab_ros.georeferencing.stillness import with_movement
from stab_ros.georeferencing.tilt import TiltEstimate
from stab_ros.imaging.camera import Camera
from stab_ros.imaging.pose import Pose


class StationaryNadir:
    """Height above the water and K give the scale.

    Control points, where there are any, tell place and heading, and by their residuals whether the view is nadir; so
    do homographies, once the camera moves. Without points, the origin of the map lies below the camera.
    """

    needs_motion = False
    needs_sensors = False
    needs_picture = False

    def __init__(self, config: GeoreferenceConfig, camera: Camera, gcps: ControlPoints | None) -> None:
        """Prepares for a stream.

        Args:
            config: the settings.
            camera: that takes the images.
            gcps: control points; None: there are none.

        Raises:
            ConfigError: without `height_m`, or by points that are too few, above the camera or swapped.
        """
        if not config.height_m:
            raise ConfigError("stationary_nadir needs height_m, the height of the camera above the water in metres")
        up_m = config.wse_m + config.height_m
        self._camera, self._tilt = camera, TiltEstimate(camera.K)
        self._values: dict[str, float] = {}
        self._warnings: tuple[str, ...] = ()
        if gcps is None:
            self._pose = Pose.of_angles(np.array([0, 0, up_m]), config.yaw_rad, math.pi / 2, 0)
        else:
            found = nadir_by_points(camera, up_m, gcps)
            self._pose, self._warnings = found.pose, doubts_of_nadir(config, camera, gcps, found)
            self._values = {"rmse_px": found.rmse_px, "rmse_m": found.rmse_m, "gcps": float(len(gcps))}
        self._covariance = np.diag([0, 0, config.height_sigma_m**2, 0, 0, 0])

    def place(self, sighting: Sighting) -> Answer:
        """The same pose for every frame."""
        if sighting.ref_H_cur is not None and sighting.covariance is not None:
            self._tilt.add(sighting.ref_H_cur, sighting.covariance)
        warnings = tuple(filter(None, (*self._warnings, self._tilt.doubt)))
        answer = placed(self._camera, self._pose, self._covariance, sighting.wse_m, sighting.wse_sigma_m, self._values,
                        warnings)
        return with_movement(answer, sighting)
