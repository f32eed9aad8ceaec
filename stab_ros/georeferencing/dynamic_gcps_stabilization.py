"""`dynamic_gcps_stabilization`: homographies to a reference that control points place (Perks 2020, section 2.2.1)."""

from __future__ import annotations

from dataclasses import replace

from stab_ros.georeferencing.gcp_fit import GcpFit
from stab_ros.georeferencing.moved import ReferencePlace, placed_by_motion
from stab_ros.georeferencing.orientation import Answer, Unplaced
from stab_ros.georeferencing.placement import Placement, Sighting
from stab_ros.georeferencing.plane_fit import PlaneFit
from stab_ros.georeferencing.settings import GeoreferenceConfig


class DynamicGcpsStabilization:
    """The control points are marked in the reference; from there on, the homographies tell."""

    needs_motion = True
    needs_sensors = False
    needs_picture = False

    def __init__(self, config: GeoreferenceConfig, found: GcpFit) -> None:
        """found: the fit to the control points of the reference."""
        ground_m = config.wse_m + config.ground_above_wse_m
        plane_m = found.fit.wse_m if isinstance(found.fit, PlaneFit) else ground_m
        self._found = found
        self._reference = ReferencePlace(*found.on_plane(plane_m), plane_m, found.focal_spread)
        self._resets: int | None = None  # at the first frame

    def place(self, sighting: Sighting) -> Answer:
        """The place of the reference, moved along."""
        found = self._found
        if self._resets is None:
            self._resets = sighting.reset_counter
        if sighting.reset_counter != self._resets:
            return Unplaced("the stabiliser has taken another reference, in which no control points are marked")
        answer = placed_by_motion(found.camera, found.calibrated, self._reference, sighting, found.values,
                                  found.warnings)
        if not isinstance(answer, Placement):
            return answer
        return replace(answer, rejected=found.fit.wrong, worst_point=found.worst_point)
