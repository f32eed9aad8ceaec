"""`dynamic_stabilization`: homographies to a nadir reference of known scale (Perks 2020, section 2.2.1)."""

from __future__ import annotations

import numpy as np

from stab_ros.core.errors import ConfigError
from stab_ros.georeferencing.known_scale import contradiction, known_scales, nadir_H
from stab_ros.georeferencing.moved import ReferencePlace, placed_by_motion
from stab_ros.georeferencing.orientation import Answer, Unplaced
from stab_ros.georeferencing.placement import Sighting
from stab_ros.georeferencing.settings import GeoreferenceConfig
from stab_ros.georeferencing.tilt import TiltEstimate
from stab_ros.imaging.camera import Camera


class DynamicStabilization:
    """The reference looks straight down; the origin of the map lies below its camera."""

    needs_motion = True
    needs_sensors = False

    def __init__(self, config: GeoreferenceConfig, camera: Camera, calibrated: bool) -> None:
        """Prepares for a stream.

        Args:
            config: the settings.
            camera: that takes the images.
            calibrated: whether its K is known.

        Raises:
            ConfigError: the settings tell no scale, or the scale of another plane.
        """
        above_m = config.ground_above_wse_m
        scales = known_scales(config, camera.K[0, 0] if calibrated else None, above_m)
        if not scales:
            raise ConfigError("dynamic_stabilization needs a scale: gsd_m, known_distance, or height_m and the "
                              "calibration of the camera")
        if above_m and not calibrated:
            raise ConfigError("ground_above_wse_m needs the calibration of the camera")
        self._camera, self._calibrated = camera, calibrated
        used, *others = scales
        H = nadir_H(camera, used.gsd_m, config.yaw_rad)
        by_scale = np.concatenate([H[:2].ravel(), [0, 0]])  # d h / d ln(gsd)
        self._reference = ReferencePlace(H, used.sigma * by_scale[:, None], config.wse_m + above_m)
        self._warnings = tuple(filter(None, (contradiction(used, other) for other in others)))
        self._tilt = TiltEstimate(camera.K)
        self._resets: int | None = None  # at the first frame

    def place(self, sighting: Sighting) -> Answer:
        """The place of the reference, moved along."""
        if self._resets is None:
            self._resets = sighting.reset_counter
        if sighting.reset_counter != self._resets:
            return Unplaced("the stabiliser has taken another reference, whose place is not known")
        return placed_by_motion(self._camera, self._calibrated, self._reference, sighting, {}, self._doubts(sighting))

    def _doubts(self, sighting: Sighting) -> tuple[str, ...]:
        if self._calibrated and sighting.ref_H_cur is not None and sighting.covariance is not None:
            self._tilt.add(sighting.ref_H_cur, sighting.covariance)
        return tuple(filter(None, (*self._warnings, self._tilt.doubt)))
