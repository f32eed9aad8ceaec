"""The start of a stream, deferred: its frames are followed without an answer until it is known what is ground.

Only what became of each feature is kept, no picture; once the start is over, the frames are answered late, all at once.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stab_ros.core.doubt import Doubt
from stab_ros.core.geometry import apply, inside
from stab_ros.core.ground_choice import Choice, Scene, choose_ground
from stab_ros.core.planes import Plane, find_planes
from stab_ros.core.reference import Reference
from stab_ros.core.static_map import StaticMap
from stab_ros.core.survey import Survey, Trajectories
from stab_ros.core.types import BoolArray, Correspondences, FloatArray, Gray, Homography

_LEAST_FEATURES = 48  # with fewer there is nothing to choose between
# if less of it was seen, as where the first frames were dropped, it may take so many times as long
_SEEN_SHARE, _PATIENCE = 0.5, 3
_MOST_FRAMES = 120  # where time does not advance


@dataclass(frozen=True, eq=False)
class Opening:
    """One deferred frame: its number, stamp and time, what it shows of the features, and roughly where it lies.

    trust: (N,) of the pairs, 1 for ground, 0 for the rest.
    """

    index: int
    stamp_ns: int
    time_ns: int
    pairs: Correspondences
    trust: FloatArray
    guess: Homography


@dataclass(frozen=True, eq=False)
class Outcome:
    """What the start has shown. ground_px: (n, 2) features of the ground in the reference. size: of that, px.

    doubt: if something else may be the ground as well.
    """

    openings: list[Opening]
    ground_px: FloatArray
    static_map: StaticMap
    doubt: Doubt | None
    size: tuple[int, int]

    def expected(self, ref_H_cur: Homography) -> float:
        """How many features of the ground a frame there should show."""
        return float(inside(apply(np.linalg.inv(ref_H_cur), self.ground_px), self.size).sum())


class Deferral:
    """Follows the frames after a reference for a while."""

    def __init__(self, reference: Reference, allowed: BoolArray, start_ns: int, duration_ns: int) -> None:
        """allowed: (h, w) bool, where ground may be. start_ns: time of the reference. duration_ns: from there on."""
        self.reference, self._duration_ns = reference, duration_ns
        self._size, self._start_ns = reference.frame.size, start_ns
        self._survey = Survey(reference.gray, allowed)
        self._indices: list[int] = []
        self._stamps_ns: list[int] = []
        self._times_ns: list[int] = []

    @property
    def useful(self) -> bool:
        """Whether the reference shows enough to follow."""
        return len(self._survey.reference_px) >= _LEAST_FEATURES

    @property
    def over(self) -> bool:
        """Whether the last frame has brought the start to its end."""
        if not self._times_ns:
            return False
        first_ns, last_ns = self._times_ns[0], self._times_ns[-1]
        elapsed_ns, enough = last_ns - self._start_ns, last_ns - first_ns >= _SEEN_SHARE * self._duration_ns
        long = elapsed_ns >= self._duration_ns * (1 if enough else _PATIENCE)
        return long or elapsed_ns < 0 or len(self._times_ns) >= _MOST_FRAMES

    def follow(self, index: int, stamp_ns: int, time_ns: int, gray: Gray) -> None:
        """Takes the next frame, (h, w) uint8. stamp_ns: of its header, which may jump. time_ns: of the stream."""
        self._survey.follow(gray)
        self._indices.append(index)
        self._stamps_ns.append(stamp_ns)
        self._times_ns.append(time_ns)

    def outcome(self) -> Outcome:
        """What is ground, and the frames so far in its light; everything, if the features show no plane."""
        trajectories = self._survey.trajectories()
        planes = find_planes(trajectories)
        if not planes:
            everything = Plane(np.ones(len(trajectories.reference_px), bool), trajectories.shapes)
            return self._judged(Choice(everything), trajectories)
        elapsed_s = (np.array(self._times_ns) - self._start_ns) / 1e9
        scene = Scene(trajectories.reference_px, self._size, elapsed_s)
        return self._judged(choose_ground(planes, scene), trajectories)

    def _judged(self, choice: Choice, trajectories: Trajectories) -> Outcome:
        """The frames so far in the light of a choice."""
        ground, openings = choice.ground, []
        places = np.where(np.isnan(ground.ref_H_cur), trajectories.shapes, ground.ref_H_cur)
        for k, which in enumerate(zip(self._indices, self._stamps_ns, self._times_ns, strict=True)):
            pairs = trajectories.pairs(k)
            openings.append(Opening(*which, pairs, ground.member[pairs.feature_id].astype(float), places[k]))
        rival = choice.rival
        doubt = None if rival is None else Doubt(rival, self._map(rival.plane), self._start_ns, self._size)
        return Outcome(openings, trajectories.reference_px[ground.member], self._map(ground), doubt, self._size)

    def _map(self, plane: Plane) -> StaticMap:
        return StaticMap.of_features(self._survey.reference_px, plane.member.astype(float), self._size)
