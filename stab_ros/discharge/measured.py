"""Which verticals of a section have vectors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stab_ros.core.types import BoolArray, FloatArray, IdArray
from stab_ros.discharge.wetted import wet_lengths_m


@dataclass(frozen=True, eq=False)
class Measured:
    """Which verticals have vectors.

    Attributes:
        chainage_m: (N,).
        depth_m: (N,), nominal; negative above the water.
        channel: (N,), of `channels`.
        known: (N,), whether a vertical has vectors; at least one does.
    """

    chainage_m: FloatArray
    depth_m: FloatArray
    channel: IdArray
    known: BoolArray

    def neighbours(self, channel: int) -> IdArray:
        """The known verticals from which those of a channel are filled: its own, or all where it has none."""
        own = np.flatnonzero(self.known & (self.channel == channel))
        return (own if len(own) else np.flatnonzero(self.known)).astype(np.int64)

    @property
    def away(self) -> FloatArray:
        """(N,), distance from the nearest known vertical over the wet width; 0 at known ones."""
        distance_m = np.abs(self.chainage_m[:, None] - self.chainage_m[self.known]).min(axis=1)
        return np.asarray(distance_m / wet_lengths_m(self.chainage_m, self.depth_m).sum())
