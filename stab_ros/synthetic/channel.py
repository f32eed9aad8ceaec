"""A channel on the water plane of the map: its centre line, banks and islands.

The river flows to the east. Its width is measured along the north and is the same everywhere, so that a flow that
follows the channel conserves its volume exactly (`velocity_fields.ChannelFlow`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stab_ros.core.errors import InputError
from stab_ros.core.types import FloatArray
from stab_ros.synthetic.river import SceneSettings
from stab_ros.synthetic.terrain import BEND_PHASE, Layout


@dataclass(frozen=True)
class EllipticIsland:
    """Dry ground in the channel: centre and half axes to the east and to the north, m.

    Raises:
        InputError: a half axis that is not positive.
    """

    centre_m: tuple[float, float]
    half_axes_m: tuple[float, float]

    def __post_init__(self) -> None:
        if min(self.half_axes_m) <= 0:
            raise InputError(f"an island with half axes of {self.half_axes_m} m, they must be positive")

    def openness(self, points_m: FloatArray) -> FloatArray:
        """How little the island matters at points (N, 2): (N,), 0 on it and its shore, 1 far from it.

        1 - exp(1 - r^2) with r = 1 on the shore. Its slope there is that of the potential flow round a cylinder.
        """
        return np.asarray(1 - np.minimum(np.exp(1 - self._r2(points_m)), 1))

    def openness_gradient(self, points_m: FloatArray) -> FloatArray:
        """Derivative (N, 2) of `openness` to the east and to the north, 1/m."""
        r2 = self._r2(points_m)
        share = np.where(r2 > 1, 2 * np.exp(1 - r2), 0)
        return np.asarray(share[:, None] * (points_m - self.centre_m) / np.square(self.half_axes_m))

    def _r2(self, points_m: FloatArray) -> FloatArray:
        x = (points_m[:, 0] - self.centre_m[0]) / self.half_axes_m[0]
        y = (points_m[:, 1] - self.centre_m[1]) / self.half_axes_m[1]
        return np.asarray(x * x + y * y)


@dataclass(frozen=True)
class Channel:
    """A channel along a sinuous centre line: north = middle_m + bend_m sin(bend_per_m east + bend_phase).

    Attributes:
        half_width_m: from the centre line to a bank, along the north.
        middle_m: mean north of the centre line.
        bend_m: amplitude of the centre line.
        bend_per_m: its wave number, rad/m.
        bend_phase: its phase at east = 0, rad.
        islands: dry ground in it.

    Raises:
        InputError: a width that is not positive.
    """

    half_width_m: float
    middle_m: float = 0.0
    bend_m: float = 0.0
    bend_per_m: float = 0.0
    bend_phase: float = 0.0
    islands: tuple[EllipticIsland, ...] = ()

    def __post_init__(self) -> None:
        if self.half_width_m <= 0:
            raise InputError(f"a channel with a half width of {self.half_width_m} m, it must be positive")

    @staticmethod
    def of(scene: SceneSettings) -> Channel:
        """The channel of a scene of `river`; its shores in pictures wander about the nominal ones by some 2 %."""
        layout = Layout.of(scene)
        islands = tuple(EllipticIsland((float(x), -float(y)), (float(a), float(b))) for x, y, a, b in layout.islands)
        return Channel(layout.half_width_m, -layout.centre_m, -layout.bend_m, layout.bend_per_m, BEND_PHASE, islands)

    def centre_north_m(self, east_m: FloatArray) -> FloatArray:
        """North (N,) of the centre line at places (N,) along the east."""
        return np.asarray(self.middle_m + self.bend_m * np.sin(self.bend_per_m * east_m + self.bend_phase))

    def slope(self, east_m: FloatArray) -> FloatArray:
        """Slope (N,) of the centre line, north by east."""
        return np.asarray(self.bend_m * self.bend_per_m * np.cos(self.bend_per_m * east_m + self.bend_phase))

    def across(self, points_m: FloatArray) -> FloatArray:
        """Position (N,) of points (N, 2) between the banks: -1 in the south, 0 on the centre line, 1 in the north."""
        return np.asarray((points_m[:, 1] - self.centre_north_m(points_m[:, 0])) / self.half_width_m)
