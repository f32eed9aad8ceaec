"""The motion of the camera, and where a constant velocity takes it next."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stab_ros.core.types import Homography


@dataclass(frozen=True, eq=False)
class CameraMotion:
    """ref_H_cur and time of the last tracked frame, and of the one before it (None: unknown)."""

    last: Homography
    last_ns: int
    previous: Homography | None = None
    previous_ns: int = 0

    def then(self, ref_H_cur: Homography, time_ns: int) -> CameraMotion:
        """The motion after one more tracked frame."""
        return CameraMotion(ref_H_cur, time_ns, self.last, self.last_ns)

    def standing(self) -> CameraMotion:
        """The motion after a lost frame: the velocity is unknown."""
        return CameraMotion(self.last, self.last_ns)

    def predict(self, time_ns: int) -> Homography:
        """ref_H_cur at constant velocity; the last one where the stamps give no velocity or would extrapolate far."""
        elapsed, ahead = self.last_ns - self.previous_ns, time_ns - self.last_ns
        if self.previous is None or elapsed <= 0 or not 0 < ahead <= 3 * elapsed:
            return self.last
        step = self.last @ np.linalg.inv(self.previous)
        onward = np.eye(3) + (step / step[2, 2] - np.eye(3)) * (ahead / elapsed)
        predicted = onward @ self.last
        return np.asarray(predicted / predicted[2, 2])
