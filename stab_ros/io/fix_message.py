"""sensor_msgs/NavSatFix: a position of a satellite receiver, in degrees and metres above the ellipsoid."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
from rosbags.typesys.stores.ros2_jazzy import sensor_msgs__msg__NavSatFix as NavSatFix
from rosbags.typesys.stores.ros2_jazzy import sensor_msgs__msg__NavSatStatus as NavSatStatus

from stab_ros.core.types import FloatArray
from stab_ros.io.cdr import NAV_SAT_FIX, Header, deserialize, header_message, serialize, to_ns
from stab_ros.io.sensor_covariance import known_covariance

UNKNOWN_STATUS, NO_FIX, FIX, SBAS_FIX, GBAS_FIX = range(-2, 3)  # NavSatStatus; the last is a fix of RTK or PPK


@dataclass(frozen=True, eq=False)
class Fix:
    """A position, not yet in the map.

    Attributes:
        stamp_ns: when it was measured.
        latitude_deg: north of the equator, WGS 84.
        longitude_deg: east of Greenwich.
        height_m: above the ellipsoid, as the message defines it (many drones send another); NaN: unknown.
        covariance_m2: (3, 3) float64 of east, north and up; None: unknown.
        status: of NavSatStatus, -2 (unknown) to 2 (RTK, PPK).
        frame_id: of the antenna.
        fault: why it is no position, in words; empty: it is one.
        doubt: what it does not say, in words; empty: it says all.
    """

    stamp_ns: int
    latitude_deg: float
    longitude_deg: float
    height_m: float
    covariance_m2: FloatArray | None = None
    status: int = FIX
    frame_id: str = ""
    fault: str = ""
    doubt: str = ""


def read_fix(cdr: bytes | memoryview) -> Fix:
    """The position in a NavSatFix; one that cannot be used says so in `fault`.

    Raises:
        MessageError: damaged.
    """
    message = cast(NavSatFix, deserialize(cdr, NAV_SAT_FIX))
    covariance, unknown = _covariance(message)
    height = "" if math.isfinite(message.altitude) else "it has no altitude"
    status = "" if message.status.status != UNKNOWN_STATUS else "its status is unknown"
    return Fix(to_ns(message.header.stamp), message.latitude, message.longitude, message.altitude, covariance,
               message.status.status, message.header.frame_id, _fault(message),
               ", ".join(filter(None, (status, height, unknown))))


def _fault(message: NavSatFix) -> str:
    latitude, longitude = message.latitude, message.longitude
    if message.status.status == NO_FIX:
        return "it says that there is no fix"
    return fault_of_place(latitude, longitude)


def fault_of_place(latitude_deg: float, longitude_deg: float) -> str:
    """Why two numbers are no place on the Earth, in words; empty: they are one."""
    if not (math.isfinite(latitude_deg) and math.isfinite(longitude_deg)):
        return "its latitude and longitude are not finite"
    if latitude_deg == longitude_deg == 0:
        return "its latitude and longitude are zero, as before the first fix"
    if abs(latitude_deg) > 90:
        swapped = " (longitude and latitude may be swapped)" if abs(longitude_deg) <= 90 else ""
        return f"its latitude is {latitude_deg:g}, it must lie within 90 degrees{swapped}"
    if abs(longitude_deg) > 360:
        return f"its longitude is {longitude_deg:g}, it must lie within 360 degrees"
    return ""


def _covariance(message: NavSatFix) -> tuple[FloatArray | None, str]:
    if message.position_covariance_type == message.COVARIANCE_TYPE_UNKNOWN:
        return None, "its covariance is unknown (type 0)"
    return known_covariance(message.position_covariance)


def fix_cdr(fix: Fix) -> bytes:
    """NavSatFix of a position; its `fault` and `doubt` are not written."""
    known = fix.covariance_m2 is not None
    elements = np.zeros(9) if fix.covariance_m2 is None else np.array(fix.covariance_m2, np.float64).ravel()
    kind = NavSatFix.COVARIANCE_TYPE_KNOWN if known else NavSatFix.COVARIANCE_TYPE_UNKNOWN
    status: Any = NavSatStatus(status=fix.status, service=NavSatStatus.SERVICE_GPS)  # to rosbags' types it is Dashing's
    return serialize(NavSatFix(
        header=header_message(Header(fix.stamp_ns, fix.frame_id)), status=status, latitude=fix.latitude_deg,
        longitude=fix.longitude_deg, altitude=fix.height_m, position_covariance=elements,
        position_covariance_type=kind), NAV_SAT_FIX)
