"""Samples of positioning and attitude sensors, as the engine takes them live and offline."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stab_ros.core.errors import InputError
from stab_ros.core.types import FloatArray


@dataclass(frozen=True, eq=False)
class PositionSample:
    """A position of the antenna.

    Attributes:
        stamp_ns: when it was measured, on the clock of the frames once `time_offset_s` is applied.
        position_m: (3,) float64, east, north and up in the map.
        covariance_m2: (3, 3) float64; None: the sensor does not tell.
    """

    stamp_ns: int
    position_m: FloatArray
    covariance_m2: FloatArray | None = None

    def __post_init__(self) -> None:
        _check(self.position_m, 3, self.covariance_m2, "position")


@dataclass(frozen=True, eq=False)
class AttitudeSample:
    """An attitude of the camera's mount (gimbal) or of the drone's body.

    Attributes:
        stamp_ns: as for `PositionSample`.
        map_q_body: (4,) float64, quaternion x, y, z, w from the body (x forward, y left, z up) to the map.
        covariance_rad2: (3, 3) float64, of rotations about the axes of the body; None: the sensor does not tell.
    """

    stamp_ns: int
    map_q_body: FloatArray
    covariance_rad2: FloatArray | None = None

    def __post_init__(self) -> None:
        _check(self.map_q_body, 4, self.covariance_rad2, "attitude")


def _check(values: FloatArray, count: int, covariance: FloatArray | None, what: str) -> None:
    if values.shape != (count,) or not np.isfinite(values).all():
        raise InputError(f"a {what} must be {count} finite numbers")
    if covariance is not None and (covariance.shape != (3, 3) or not np.isfinite(covariance).all()):
        raise InputError(f"the covariance of a {what} must be 3x3 finite numbers")
