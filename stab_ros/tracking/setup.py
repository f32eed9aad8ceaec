"""Everything that a tracker is given: settings, camera, and what the user knows of the scene."""

from __future__ import annotations

from dataclasses import dataclass, replace

from stab_ros.core.errors import InputError
from stab_ros.core.region import Area
from stab_ros.core.types import FloatArray, Frame, ResetReason
from stab_ros.methods import METHODS
from stab_ros.tracking.anchor import AnchorFactory
from stab_ros.tracking.points import check_count
from stab_ros.tracking.preprocessing import Preprocessing
from stab_ros.tracking.session import Session
from stab_ros.tracking.settings import StabilizerConfig
from stab_ros.tracking.static_map import StaticMap


@dataclass(frozen=True, eq=False)
class Setup:
    """area, points_px (n, 2), static_map: as of `Stabilizer`.

    Raises:
        InputError: the method takes no points, or they are too few.
    """

    config: StabilizerConfig
    area: Area
    points_px: FloatArray
    preprocessing: Preprocessing
    static_map: StaticMap | None

    def __post_init__(self) -> None:
        method = self.config.method
        if len(self.points_px) and not METHODS[method].takes_points:
            raise InputError(f"points: {method} finds its features itself, leave out points_file and manual_points")
        check_count(self.points_px, self.config.model, self.config.min_inliers)

    def changed(self, config: StabilizerConfig, area: Area, points_px: FloatArray) -> Setup:
        """The same camera and map with other settings."""
        return replace(self, config=config, area=area, points_px=points_px)

    @property
    def start_ns(self) -> int:
        """Length of the start-up; 0 where it is given what is ground."""
        known = self.static_map or self.area.roi or len(self.points_px)
        return 0 if known else round(self.config.start_s * 1e9)

    def anchors(self, size: tuple[int, int]) -> AnchorFactory:
        """Makes anchors in a reference of this size (width, height)."""
        allowed = self.preprocessing.allowed(self.area, size)
        return AnchorFactory(self.config.method, self.config.method_config, allowed, self.points_px)

    def session(self, frame: Frame, static_map: StaticMap | None, time_ns: int, reset_counter: int,
                reset_reason: ResetReason | None = None) -> Session | None:
        """A session whose reference is the frame; None where that has too little texture or too few features.

        Raises:
            InputError: a region, a point or the map does not fit the frame.
        """
        if static_map is not None:
            static_map.check_size(frame.size)
        reference = self.preprocessing.reference(frame)
        if reference is None:
            return None
        factory = self.anchors(frame.size)
        anchor = factory.reference(reference.gray)
        if len(anchor.features_px) < self.config.min_inliers:
            return None
        return Session(reference, anchor, factory, self.config, static_map, time_ns, reset_counter, reset_reason)
