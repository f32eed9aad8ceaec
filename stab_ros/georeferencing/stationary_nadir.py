"""`stationary_nadir`: a camera that looks straight down from a known height (Perks 2020, section 2.2.1)."""

from __future__ import annotations

import math

import numpy as np

from stab_ros.core.errors import ConfigError
from stab_ros.georeferencing.orientation import Answer
from stab_ros.georeferencing.placement import Sighting
from stab_ros.georeferencing.posed import placed
from stab_ros.georeferencing.settings import GeoreferenceConfig
from stab_ros.imaging.camera import Camera
from stab_ros.imaging.pose import Pose


class StationaryNadir:
    """Height above the water and K give the scale; the origin of the map lies below the camera."""

    needs_motion = False
    needs_sensors = False

    def __init__(self, config: GeoreferenceConfig, camera: Camera) -> None:
        """Raises ConfigError without `height_m`."""
        if not config.height_m:
            raise ConfigError("stationary_nadir needs height_m, the height of the camera above the water in metres")
        self._camera = camera
        self._pose = Pose.of_angles(np.array([0, 0, config.wse_m + config.height_m]), config.yaw_rad, math.pi / 2, 0)
        self._covariance = np.diag([0, 0, config.height_sigma_m**2, 0, 0, 0])

    def place(self, sighting: Sighting) -> Answer:
        """The same pose for every frame."""
        return placed(self._camera, self._pose, self._covariance, sighting.wse_m, sighting.wse_sigma_m, {})
