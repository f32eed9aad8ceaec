"""The height of the water plane: std_msgs/Float64, or the z of a geometry_msgs/PointStamped."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import cast

from rosbags.typesys.stores import ros2_jazzy as ros

from stab_ros.core.errors import MessageError
from stab_ros.io.cdr import FLOAT64, POINT_STAMPED, deserialize, to_ns

WATER_LEVEL_TYPES = (FLOAT64, POINT_STAMPED)
NO_STAMP = 0  # of a level that does not say when it was measured


@dataclass(frozen=True)
class WaterLevel:
    """The elevation of the water surface.

    Attributes:
        stamp_ns: when it was measured; of a Float64, when it came.
        wse_m: water surface elevation, in the heights of the map.
        frame_id: that the height refers to; empty: not said.
        fault: why it is none, in words; empty: it is one.
    """

    stamp_ns: int
    wse_m: float
    frame_id: str = ""
    fault: str = ""


def read_water_level(cdr: bytes | memoryview, msgtype: str, received_ns: int) -> WaterLevel:
    """The water level in a message of one of WATER_LEVEL_TYPES; one that cannot be used says so in `fault`.

    received_ns: when it came: a Float64 has no stamp.

    Raises:
        MessageError: damaged, or of another type.
    """
    if msgtype == FLOAT64:
        number = cast(ros.std_msgs__msg__Float64, deserialize(cdr, FLOAT64))
        return _level(received_ns, number.data, "")
    if msgtype == POINT_STAMPED:
        stamped = cast(ros.geometry_msgs__msg__PointStamped, deserialize(cdr, POINT_STAMPED))
        return _level(to_ns(stamped.header.stamp), stamped.point.z, stamped.header.frame_id)
    raise MessageError(f"{msgtype} holds no water level, it must be {' or '.join(WATER_LEVEL_TYPES)}")


def _level(stamp_ns: int, wse_m: float, frame_id: str) -> WaterLevel:
    return WaterLevel(stamp_ns, wse_m, frame_id, "" if math.isfinite(wse_m) else "its height is not finite")
