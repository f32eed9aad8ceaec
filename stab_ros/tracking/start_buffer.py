"""The start of a stream, deferred: its frames are followed without an answer until it is known what is ground.

Only what became of each feature is kept, no picture; once the start is over, the frames are answered late, all at once.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np

from stab_ros.core.geometry import apply, inside
from stab_ros.core.types import BoolArray, Correspondences, FloatArray, Gray, Homography
from stab_ros.tracking.ambiguity import Ambiguity
from stab_ros.tracking.ground_choice import Choice, Observations, choose_ground
from stab_ros.tracking.planes import Plane, find_planes
from stab_ros.tracking.reference import Reference
from stab_ros.tracking.static_map import StaticMap
from stab_ros.tracking.survey import Survey, Trajectories

_LEAST_FEATURES = 48  # with fewer there is nothing to choose between
# if less of it was seen, as where the first frames were dropped, it may take so many times as long
_SEEN_SHARE, _PATIENCE = 0.5, 3
_MOST_FRAMES = 120  # where time does not advance


class GroundState(Enum):
    """What is known of it. PROVISIONAL: frames had to be answered before enough was seen; it is decided anew."""

    UNDECIDED = "undecided"
    PROVISIONAL = "provisional"
    DECIDED = "decided"


@dataclass(frozen=True, eq=False)
class BufferedFrame:
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
class StartResult:
    """What the start has shown. ground_px: (n, 2) features of the ground in the reference. size: of that, px.

    openings: of the frames that had no answer yet. doubt: if something else may be the ground as well. turned: whether
    an earlier outcome took something else for it. provisional: too little was seen to be certain.
    """

    openings: list[BufferedFrame]
    ground_px: FloatArray
    static_map: StaticMap
    doubt: Ambiguity | None
    size: tuple[int, int]
    turned: bool
    provisional: bool

    def expected(self, ref_H_cur: Homography) -> float:
        """How many features of the ground a frame there should show."""
        return float(inside(apply(np.linalg.inv(ref_H_cur), self.ground_px), self.size).sum())


class StartBuffer:
    """Follows the frames after a reference for a while."""

    def __init__(self, reference: Reference, allowed: BoolArray, start_ns: int, duration_ns: int) -> None:
        """allowed: (h, w) bool, where ground may be. start_ns: time of the reference. duration_ns: from there on."""
        self.reference, self._duration_ns = reference, duration_ns
        self._size, self._start_ns = reference.frame.size, start_ns
        self._survey = Survey(reference.gray, allowed)
        self._answered = 0  # of the frames so far
        self._taken: BoolArray | None = None  # (N,) the features of what was taken for ground
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
        elapsed_ns = self._times_ns[-1] - self._start_ns
        long = elapsed_ns >= self._duration_ns * (1 if self.enough else _PATIENCE)
        return long or elapsed_ns < 0 or len(self._times_ns) >= _MOST_FRAMES

    @property
    def enough(self) -> bool:
        """Whether half of its length was seen."""
        seen_ns = self._times_ns[-1] - self._times_ns[0] if self._times_ns else 0
        return seen_ns >= _SEEN_SHARE * self._duration_ns

    @property
    def ground(self) -> GroundState:
        """What is known of it so far."""
        return GroundState.PROVISIONAL if self._answered else GroundState.UNDECIDED

    @property
    def waiting(self) -> int:
        """How many frames are not answered yet."""
        return len(self._times_ns) - self._answered

    def follow(self, index: int, stamp_ns: int, time_ns: int, gray: Gray) -> None:
        """Takes the next frame, (h, w) uint8. stamp_ns: of its header, which may jump. time_ns: of the stream."""
        self._survey.follow(gray)
        self._indices.append(index)
        self._stamps_ns.append(stamp_ns)
        self._times_ns.append(time_ns)

    def outcome(self, provisional: bool = False) -> StartResult:
        """What is ground, and the frames without an answer in its light; everything, if the features show no plane.

        provisional: as no frame comes, before the start is over; then whatever moves otherwise may be the ground.
        """
        trajectories = self._survey.trajectories()
        choice = self._choice(trajectories, provisional)
        member, before = choice.ground.member, self._taken
        turned = before is not None and 2 * np.sum(member & before) < min(np.sum(member), np.sum(before))
        self._taken = member
        rival = choice.rival
        doubt = None if rival is None else Ambiguity(rival, self._map(rival.plane), self._start_ns, self._size)
        return StartResult(self._openings(choice.ground, trajectories), trajectories.reference_px[member],
                       self._map(choice.ground), doubt, self._size, bool(turned), provisional or not self.enough)

    def _choice(self, trajectories: Trajectories, provisional: bool) -> Choice:
        planes = find_planes(trajectories)
        if not planes:
            return Choice(Plane(np.ones(len(trajectories.reference_px), bool), trajectories.shapes))
        elapsed_s = (np.array(self._times_ns) - self._start_ns) / 1e9
        return choose_ground(planes, Observations(trajectories.reference_px, self._size, elapsed_s), provisional)

    def _openings(self, ground: Plane, trajectories: Trajectories) -> list[BufferedFrame]:
        """The frames that have no answer yet, in the light of a choice; with this they have one."""
        first, self._answered = self._answered, len(self._times_ns)
        places = np.where(np.isnan(ground.ref_H_cur), trajectories.shapes, ground.ref_H_cur)
        openings = []
        for k in range(first, self._answered):
            pairs = trajectories.pairs(k)
            openings.append(BufferedFrame(self._indices[k], self._stamps_ns[k], self._times_ns[k], pairs,
                                    ground.member[pairs.feature_id].astype(float), places[k]))
        return openings

    def _map(self, plane: Plane) -> StaticMap:
        return StaticMap.of_features(self._survey.reference_px, plane.member.astype(float), self._size)
