"""How windows lie in a later frame if the water plane carries them: camera motion and lens without the flow."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stab_ros.core.types import BoolArray, FloatArray, IdArray
from stab_ros.velocimetry.placed_frame import PlacedFrame
from stab_ros.velocimetry.places import pixels_of, places_of

_PRISM_PX = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])


@dataclass(frozen=True, eq=False)
class Footprints:
    """Where N windows lay on the plane when they were cut.

    Attributes:
        stamp_ns: (N,) int64, of the frames in which they were cut.
        corners_m: (N, 3, 2), places of the centre of each, and of the pixels right of it and below it.
    """

    stamp_ns: IdArray
    corners_m: FloatArray

    @staticmethod
    def of(frame: PlacedFrame, centres_px: FloatArray) -> Footprints:
        """Those of windows that are cut at pixels (N, 2) as taken."""
        corners_px = (centres_px[:, None] + _PRISM_PX).reshape(-1, 2)
        return Footprints(np.full(len(centres_px), frame.stamp_ns),
                          places_of(frame, corners_px).reshape(-1, 3, 2))

    def __getitem__(self, which: IdArray | BoolArray) -> Footprints:
        return Footprints(self.stamp_ns[which], self.corners_m[which])

    def put(self, which: IdArray, other: Footprints) -> None:
        """Replaces those of `which`, (n,), by the n ones of `other`."""
        self.stamp_ns[which], self.corners_m[which] = other.stamp_ns, other.corners_m

    def elapsed_s(self, frame: PlacedFrame) -> FloatArray:
        """(N,) time from the cut to a frame, s; positive also for a frame before it."""
        return np.asarray(np.abs(frame.stamp_ns - self.stamp_ns) * 1e-9)

    def moved_px(self, places_m: FloatArray) -> FloatArray:
        """(N,) distance of places (N, 2) from the centres, in pixels of the frames in which they were cut."""
        sides = self.corners_m[:, 1:] - self.corners_m[:, :1]
        gsd_m = np.sqrt(np.abs(np.linalg.det(sides)))
        return np.asarray(np.hypot(*(places_m - self.corners_m[:, 0]).T) / gsd_m)

    def carried(self, frame: PlacedFrame, places_m: FloatArray) -> FloatArray:
        """(N, 2, 2), derivative of pixels of a frame by those of the windows, at places (N, 2) on the plane."""
        corners_m = self.corners_m + (places_m - self.corners_m[:, 0])[:, None]
        corners_px = pixels_of(frame, corners_m.reshape(-1, 2)).reshape(-1, 3, 2)
        return np.asarray((corners_px[:, 1:] - corners_px[:, :1]).transpose(0, 2, 1))
