"""What may serve as the reference, and where the camera is expected next."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from stab_ros.core.types import Frame, Gray, Homography

SMALLEST_PX = 64  # a side of a picture that can be tracked
_BLOCK_PX = 16  # of the quarter-size picture
_LEAST_GRADIENT = 0.5  # squared, grey levels^2 per px^2 of the quarter-size picture: noise has averaged out there
_LEAST_BLOCKS = 6


def is_textured(gray: Gray) -> bool:
    """Whether something can be found again in the picture: at least six blocks that no shift along a line hides.

    Judged at a quarter of the size, where 4x4 px are averaged and the noise of a flat or black picture is gone.
    """
    if min(gray.shape) < SMALLEST_PX:
        return False
    small = cv2.resize(gray, (gray.shape[1] // 4, gray.shape[0] // 4), interpolation=cv2.INTER_AREA).astype(np.float32)
    dx, dy = cv2.Sobel(small, cv2.CV_32F, 1, 0, scale=1 / 8), cv2.Sobel(small, cv2.CV_32F, 0, 1, scale=1 / 8)
    xx, xy, yy = (cv2.blur(product, (_BLOCK_PX, _BLOCK_PX)) for product in (dx * dx, dx * dy, dy * dy))
    weaker = (xx + yy) / 2 - np.sqrt(((xx - yy) / 2) ** 2 + xy**2)  # smaller eigenvalue of the structure tensor
    step = min(_BLOCK_PX, *(n // 4 for n in small.shape))
    return int(np.count_nonzero(weaker[step // 2 :: step, step // 2 :: step] > _LEAST_GRADIENT)) >= _LEAST_BLOCKS


@dataclass(frozen=True, eq=False)
class Reference:
    """The frame all others are brought back to. grey_scale: see `gray.depth_scale`."""

    frame: Frame
    gray: Gray
    grey_scale: float


@dataclass(frozen=True, eq=False)
class Motion:
    """Where the camera was in the last frame that was tracked, and in the one before."""

    last: Homography
    last_ns: int
    before: Homography | None = None
    before_ns: int = 0

    def then(self, ref_H_cur: Homography, time_ns: int) -> Motion:
        return Motion(ref_H_cur, time_ns, self.last, self.last_ns)

    def standing(self) -> Motion:
        """After a loss the speed of the camera is unknown."""
        return Motion(self.last, self.last_ns)

    def predict(self, time_ns: int) -> Homography:
        """ref_H_cur at constant velocity; the last one where stamps do not tell a velocity or would stretch it."""
        elapsed, ahead = self.last_ns - self.before_ns, time_ns - self.last_ns
        if self.before is None or elapsed <= 0 or not 0 < ahead <= 3 * elapsed:
            return self.last
        step = self.last @ np.linalg.inv(self.before)
        onward = np.eye(3) + (step / step[2, 2] - np.eye(3)) * (ahead / elapsed)
        predicted = onward @ self.last
        return np.asarray(predicted / predicted[2, 2])
