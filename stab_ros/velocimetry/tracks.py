"""The features of one interval: where each began, where it is, and how sure that is."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from stab_ros.core.types import BoolArray, FloatArray, IdArray
from stab_ros.velocimetry.placed_frame import PlacedFrame


@dataclass(eq=False)
class Tracks:
    """N features over the frames of an interval.

    Attributes:
        start_px: (N, 2), pixels as taken of the first frame.
        end_px: (N, 2), pixels as taken of the last frame that shows each.
        end_frame: (N,) index into `frames` of that frame.
        alive: (N,) bool, which are still followed.
        covariance_m2: (N, 2, 2), of the place of `end_px` relative to the start, by what each feature has by itself.
        frames: the first frame, and those since, without their images.
        places_m: of each frame, (N, 2) places on the plane; NaN where a feature was not seen.
        dragged: (N,) bool, which were dropped because two patterns have pulled at them.
    """

    start_px: FloatArray
    end_px: FloatArray
    end_frame: IdArray
    alive: BoolArray
    covariance_m2: FloatArray
    frames: list[PlacedFrame] = field(default_factory=list)
    places_m: list[FloatArray] = field(default_factory=list)
    dragged: BoolArray = field(init=False)

    def __post_init__(self) -> None:
        self.dragged = np.zeros(len(self.start_px), bool)

    @staticmethod
    def begun(frame: PlacedFrame, start_px: FloatArray, places_m: FloatArray) -> Tracks:
        """Tracks that begin at pixels (N, 2), which show these places (N, 2) on the plane."""
        n = len(start_px)
        return Tracks(start_px, start_px.copy(), np.zeros(n, np.int64), np.ones(n, bool), np.zeros((n, 2, 2)),
                      [_without_image(frame)], [places_m])

    def __len__(self) -> int:
        return len(self.start_px)

    def seen(self, frame: PlacedFrame, which: IdArray, at_px: FloatArray, places_m: FloatArray) -> None:
        """Takes where the features `which`, (n,), are in the next frame: pixels (n, 2), places (n, 2)."""
        self.frames.append(_without_image(frame))
        self.places_m.append(np.full((len(self), 2), np.nan))
        self.places_m[-1][which] = places_m
        self.end_px[which], self.end_frame[which] = at_px, len(self.frames) - 1
        self.alive = np.zeros(len(self), bool)
        self.alive[which] = True

    def drop(self, which: IdArray) -> None:
        """Lets go of the features `which`, (n,), as if they had never been seen after the first frame."""
        self.alive[which], self.end_frame[which] = False, 0

    def put_end(self, which: IdArray, at_px: FloatArray, moved_m: FloatArray, covariance_m2: FloatArray) -> None:
        """Replaces where the features `which`, (n,), are in the last frame, and forgets where they were between."""
        for places_m in self.places_m[1:-1]:
            places_m[which] = np.nan
        self.end_px[which], self.places_m[-1][which] = at_px, self.places_m[0][which] + moved_m
        self.covariance_m2[which] = covariance_m2

    @property
    def stamps_ns(self) -> IdArray:
        """(F,) of the frames."""
        return np.array([frame.stamp_ns for frame in self.frames], np.int64)


def _without_image(frame: PlacedFrame) -> PlacedFrame:
    """The frame with an image that takes no memory."""
    return replace(frame, gray=np.broadcast_to(np.uint8(0), frame.gray.shape))
