"""`stationary_gcps`: a camera that does not move, placed once by control points or by a pose that is known."""

from __future__ import annotations

from dataclasses import replace

from stab_ros.core.types import FloatArray
from stab_ros.georeferencing.gcp_fit import GcpFit
from stab_ros.georeferencing.orientation import Answer
from stab_ros.georeferencing.place_error import PlaceError, all_shared
from stab_ros.georeferencing.placement import Placement, Sighting
from stab_ros.georeferencing.posed import placed, placement
from stab_ros.georeferencing.stillness import with_movement
from stab_ros.imaging.camera import Camera
from stab_ros.imaging.pose import Pose


class StationaryGcps:
    """One fit for all frames; only the water level changes."""

    needs_motion = False
    needs_sensors = False
    needs_picture = False

    def __init__(self, found: GcpFit) -> None:
        """found: the fit to the control points."""
        self._found = found
        self._answer: tuple[tuple[float, float], Answer] | None = None  # for the last level and its sigma

    def place(self, sighting: Sighting) -> Answer:
        """The same place for every frame of one water level."""
        level = (sighting.wse_m, sighting.wse_sigma_m)
        if self._answer is None or self._answer[0] != level:
            self._answer = (level, by_fit(self._found, *level))
        return with_movement(self._answer[1], sighting)


class StationaryPose:
    """The pose of a camera.yaml for all frames."""

    needs_motion = False
    needs_sensors = False
    needs_picture = False

    def __init__(self, camera: Camera, pose: Pose, covariance: FloatArray | None) -> None:
        """covariance: (6, 6), as of `Placement`; None: unknown."""
        self._camera, self._pose, self._covariance = camera, pose, covariance

    def place(self, sighting: Sighting) -> Answer:
        """The same pose for every frame."""
        answer = placed(self._camera, self._pose, self._covariance, sighting.wse_m, sighting.wse_sigma_m, {})
        return with_movement(answer, sighting)


def by_fit(found: GcpFit, wse_m: float, wse_sigma_m: float, error: PlaceError | None = None) -> Answer:
    """The place of the frame that was fitted. error: of the fit, on the water; None: all frames share it."""
    pose, pose_covariance = None, None
    if found.pose is not None:
        pose, pose_covariance = found.pose
        if not pose.position_m[2] > wse_m:
            return placed(found.camera, pose, None, wse_m, wse_sigma_m, {})  # which says why it cannot be
    H, spread = found.on_plane(wse_m)
    error = (all_shared(spread) if error is None else error).with_shared(wse_sigma_m * found.by_level(wse_m))
    answer = placement(found.camera, H, error, pose, pose_covariance, found.values, found.warnings)
    if not isinstance(answer, Placement):
        return answer
    return replace(answer, rejected=found.fit.wrong, worst_point=found.worst_point)
