"""What the pose of a frame has in common with those of the frames before and after it.

An error that two poses share (of control points, of a known height, of the same samples of a sensor) hardly moves one
against the other. The motion between frames therefore is far better known than either pose.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from dataclasses import dataclass

import numpy as np

from stab_ros.core.types import FloatArray


@dataclass(frozen=True, eq=False)
class PoseLink:
    """How poses belong together.

    Attributes:
        chain: frames of one chain are placed alike, so that their poses differ by motion alone, and by their errors.
        by: changes (6, K) of the pose (east, north, up, m; rotations about the axes of the map, rad) by one standard
            deviation of each of K independent errors, by the source of these. Errors of one source are the same in all
            frames. What of the covariance of the pose no source explains is the frame's own.
    """

    chain: Hashable
    by: Mapping[Hashable, FloatArray]

    def shared(self, before: PoseLink) -> FloatArray:
        """Covariance (6, 6) of the errors of this pose, by row, with those of another one."""
        common = [source for source in self.by if source in before.by]
        return np.asarray(sum((self.by[source] @ before.by[source].T for source in common), np.zeros((6, 6))))
