"""What is known of the static ground in one reference: the start-up, the map, and ambiguities that are left."""

from __future__ import annotations

import numpy as np

from stab_ros.core.types import BoolArray, FloatArray, Homography
from stab_ros.tracking.ambiguity import Ambiguity, Verdict
from stab_ros.tracking.anchor import Anchor
from stab_ros.tracking.anchor_pose import AT_REFERENCE
from stab_ros.tracking.ground_choice import CompetingHypothesis
from stab_ros.tracking.sensor_fixed import fixed_area
from stab_ros.tracking.start_buffer import GroundState, StartBuffer, StartResult
from stab_ros.tracking.static_map import StaticMap

_MAP_EVERY = 50  # frames
_MAP_CHANGED = 0.03  # of the reference


class Ground:
    """Static ground, as far as it is known. buffer: follows the frames of the start-up; None outside of it."""

    def __init__(self, allowed: BoolArray, static_map: StaticMap | None) -> None:
        """allowed: (h, w) bool, where ground can be. static_map: where it is, if that is known."""
        self.static_map = static_map or StaticMap.of_mask(allowed)
        self._known = static_map is not None
        self._ambiguities: tuple[Ambiguity, ...] = ()  # the likeliest first
        self._frames = 0  # registered ones
        self.sensor_fixed_share = 0.0  # of the picture, in [0, 1], that moves with the camera
        self.buffer: StartBuffer | None = None
        self._fixed_to_camera: BoolArray | None = None

    @property
    def fixed_to_camera(self) -> BoolArray | None:
        """(h, w) bool, in px of any frame; None: nothing is known to be."""
        return self._fixed_to_camera

    def add_fixed_to_camera(self, points_px: FloatArray) -> bool:
        """Takes patches at (n, 2) for fixed to the camera; whether there are any."""
        if not len(points_px):
            return False
        area, known = fixed_area(points_px, self.static_map.size), self._fixed_to_camera
        self._fixed_to_camera = area = area if known is None else known | area
        self.sensor_fixed_share = np.count_nonzero(area) / area.size
        self.static_map = self.static_map.without(self._fixed_to_camera)
        return True

    @property
    def state(self) -> GroundState:
        """Undecided or provisional within the start-up, decided after it."""
        return GroundState.DECIDED if self.buffer is None else self.buffer.ground

    @property
    def prior(self) -> StaticMap | None:
        """The map, if it is more than what the settings allow."""
        return self.static_map if self._known else None

    @property
    def competing_hypothesis(self) -> CompetingHypothesis | None:
        """The likeliest other plane that can be the ground; None: the choice is clear."""
        return self._ambiguities[0].other if self._ambiguities else None

    def decide(self, result: StartResult) -> None:
        """Takes what the start-up has found."""
        self.static_map, self._known, self._ambiguities = result.static_map, True, result.ambiguities
        self.add_fixed_to_camera(result.fixed_px)

    def restrict(self, allowed: BoolArray) -> None:
        """Other settings allow ground elsewhere, (h, w) bool; a map that was found stays."""
        if not self._known:
            self.static_map = StaticMap.of_mask(allowed)

    def contains(self, reference_px: FloatArray) -> BoolArray:
        """(N,) bool: which of (N, 2) points lie on ground."""
        return self.static_map.at(reference_px) > 0.5

    def covariance(self, covariance: FloatArray, ref_H_cur: Homography, time_ns: int) -> FloatArray:
        """Covariance (8, 8) of a homography, inflated to span all hypotheses while the choice is ambiguous."""
        return covariance + sum(ambiguity.spread(ref_H_cur, time_ns) for ambiguity in self._ambiguities)

    def update(self, anchor: Anchor) -> None:
        """After each registered frame; now and then the map is made anew from the weights, if much has changed."""
        self._frames += 1
        if self._frames % _MAP_EVERY == 0 and anchor.pose is AT_REFERENCE and self._known:
            fresh = StaticMap.of_features(anchor.features_px, anchor.trust, self.static_map.size)
            if fresh.differs(self.static_map) > _MAP_CHANGED:
                self.static_map = fresh

    def turned(self, ref_H_cur: Homography, time_ns: int) -> Homography | None:
        """Weighs the ambiguities again; ref_H_cur by another plane if that turns out to be the ground, else None."""
        verdicts = [(ambiguity, ambiguity.weigh(ref_H_cur, time_ns)) for ambiguity in self._ambiguities]
        self._ambiguities = tuple(ambiguity for ambiguity, verdict in verdicts if verdict is Verdict.OPEN)
        ground = next((ambiguity for ambiguity, verdict in verdicts if verdict is Verdict.TURNED), None)
        if ground is None:
            return None
        self.static_map, self._ambiguities = ground.other_map, ()
        return ground.by_other(ref_H_cur, time_ns)
