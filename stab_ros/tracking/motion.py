"""The motion of the camera, where a constant velocity takes it next, and how far off that usually is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stab_ros.core.geometry import rms_distance
from stab_ros.core.types import Homography

_MEMORY_NS, _MOST_STEPS = 1_000_000_000, 120
_FEW_STEPS = 3
_LEAST_PX = 1.0  # what counts as usual in any case: a camera at rest is touched now and then


@dataclass(frozen=True)
class Step:
    """From one tracked frame to the next.

    time_ns: of the later frame. elapsed_ns: since the earlier one. moved_px: between their positions. off_px: between
    the later one and its prediction; both RMS over the grid of the frame.
    """

    time_ns: int
    elapsed_ns: int
    moved_px: float
    off_px: float


@dataclass(frozen=True, eq=False)
class CameraMotion:
    """ref_H_cur and time of the last tracked frame, and of the one before it (None: unknown).

    size: width, height, px. steps: of the last second.
    """

    size: tuple[int, int]
    last: Homography
    last_ns: int
    previous: Homography | None = None
    previous_ns: int = 0
    steps: tuple[Step, ...] = ()

    def then(self, ref_H_cur: Homography, time_ns: int) -> CameraMotion:
        """The motion after one more tracked frame."""
        step = Step(time_ns, time_ns - self.last_ns, rms_distance(ref_H_cur, self.last, self.size),
                    rms_distance(ref_H_cur, self.predict(time_ns), self.size))
        kept = [one for one in (*self.steps, step) if 0 <= time_ns - one.time_ns <= _MEMORY_NS][-_MOST_STEPS:]
        return CameraMotion(self.size, ref_H_cur, time_ns, self.last, self.last_ns, tuple(kept))

    def standing(self) -> CameraMotion:
        """The motion after a lost frame: the velocity is unknown."""
        return CameraMotion(self.size, self.last, self.last_ns, steps=self.steps)

    def at(self, ref_H_cur: Homography) -> CameraMotion:
        """The same time at another position, from where the velocity is unknown."""
        return CameraMotion(self.size, ref_H_cur, self.last_ns)

    def predict(self, time_ns: int) -> Homography:
        """ref_H_cur at constant velocity; the last one where the stamps give no velocity or would extrapolate far."""
        if self.previous is None or not self._foreseeable(time_ns):
            return self.last
        elapsed, ahead = self.last_ns - self.previous_ns, time_ns - self.last_ns
        step = self.last @ np.linalg.inv(self.previous)
        onward = np.eye(3) + (step / step[2, 2] - np.eye(3)) * (ahead / elapsed)
        predicted = onward @ self.last
        return np.asarray(predicted / predicted[2, 2])

    def usual_px(self, time_ns: int) -> float | None:
        """How far a frame usually lies from `predict`, RMS over the last second; None: too few were seen.

        It grows in proportion to the gap since the last tracked frame, across which the velocity is unknown.
        """
        if len(self.steps) < _FEW_STEPS:
            return None
        off_px = np.array([step.off_px for step in self.steps])
        moved_px = np.array([step.moved_px for step in self.steps])
        gap = self._gap(time_ns)
        unknown_px = off_px if self._foreseeable(time_ns) else np.hypot(off_px, moved_px)
        return max(_LEAST_PX, gap * float(np.sqrt(np.mean(unknown_px**2))))

    def _foreseeable(self, time_ns: int) -> bool:
        """Whether the velocity is known and tells about so late a frame."""
        elapsed, ahead = self.last_ns - self.previous_ns, time_ns - self.last_ns
        return self.previous is not None and elapsed > 0 and 0 < ahead <= 3 * elapsed

    def _gap(self, time_ns: int) -> float:
        """Time since the last tracked frame, in units of the usual time between frames, at least 1."""
        usual_ns = float(np.median([step.elapsed_ns for step in self.steps]))
        return max(1.0, (time_ns - self.last_ns) / usual_ns) if usual_ns > 0 else 1.0
