"""The error of a placement, split: what a frame has by itself, and what all frames of a stream share.

An error that two frames share (the place of the reference, the water surface elevation) hardly moves one against the
other; one of a single frame (its homography) does. What is measured between frames needs both apart.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stab_ros.core.covariance import factor
from stab_ros.core.types import FloatArray


@dataclass(frozen=True, eq=False)
class PlaceError:
    """Errors of h00 .. h21 of a homography.

    Attributes:
        own: (8, 8) covariance of the error that the frame has by itself.
        shared: (8, K) changes by one standard deviation of each of K errors, which are the same in all frames.
    """

    own: FloatArray
    shared: FloatArray

    @property
    def covariance(self) -> FloatArray:
        """(8, 8), of both."""
        return np.asarray(self.own + self.shared @ self.shared.T)

    def mapped(self, J: FloatArray) -> PlaceError:
        """The error of what depends on the homography by the derivative J (8, 8)."""
        return PlaceError(J @ self.own @ J.T, J @ self.shared)

    def with_shared(self, change: FloatArray) -> PlaceError:
        """With one shared error more, whose standard deviation changes h00 .. h21 by `change` (8,)."""
        return PlaceError(self.own, np.column_stack([self.shared, change]))

    def padded(self, columns: int) -> PlaceError:
        """With so many shared errors, the last ones 0: their number must not change within a stream."""
        return PlaceError(self.own, np.pad(self.shared, ((0, 0), (0, columns - self.shared.shape[1]))))

    def seen_by(self, own: FloatArray) -> PlaceError:
        """The same covariance, of which `own` (8, 8) is the frame's and the rest shared."""
        return PlaceError(own, factor(self.covariance - own))


def all_shared(columns: FloatArray) -> PlaceError:
    """An error that is the same in all frames. columns: (8, K)."""
    return PlaceError(np.zeros((8, 8)), columns)
