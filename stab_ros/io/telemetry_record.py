"""What a file of telemetry tells of a moment, in whatever format it came."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from stab_ros.core.types import FloatArray
from stab_ros.io.fix_message import FIX


@dataclass(frozen=True, eq=False, slots=True)
class Record:
    """A moment; what the file does not tell is None or NaN.

    Attributes:
        since_start_ns: time since the beginning of the video.
        utc_ns: since 1970, UTC.
        latitude_deg: WGS 84.
        longitude_deg: WGS 84.
        height_m: above the ellipsoid or the sea, as the file has it.
        above_takeoff_m: height above the place of take-off.
        covariance_m2: (3, 3) of east, north and up.
        status: of NavSatStatus.
        gimbal: (4,) quaternion x, y, z, w from the camera's mount (x forward, y left, z up) to east, north and up.
        body: the same of the drone.
    """

    since_start_ns: int | None = None
    utc_ns: int | None = None
    latitude_deg: float = math.nan
    longitude_deg: float = math.nan
    height_m: float = math.nan
    above_takeoff_m: float = math.nan
    covariance_m2: FloatArray | None = None
    status: int = FIX
    gimbal: FloatArray | None = None
    body: FloatArray | None = None

    @property
    def placed(self) -> bool:
        """Whether it tells a position."""
        return math.isfinite(self.latitude_deg) and math.isfinite(self.longitude_deg)

    @property
    def tells(self) -> bool:
        """Whether it tells a position or an attitude."""
        return self.placed or self.gimbal is not None or self.body is not None


@dataclass(frozen=True, eq=False)
class Recorded:
    """What a file of telemetry tells.

    Attributes:
        of_video: its times since the start are those of the video's frames.
        records: in the order of the file.
        notes: how it was taken, one line each.
        warnings: what was left out or is in doubt, one line each.
    """

    of_video: bool = False
    records: list[Record] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
