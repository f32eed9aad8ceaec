"""The unit of eastings and northings of a survey beside that of its reference system."""

from __future__ import annotations

from stab_ros.georeferencing.local_frame import metres_per_unit
from stab_ros.georeferencing.unit_checks import FOOT_M

_FEET_APART = 1e-5  # the relative difference between the feet of surveys


def unit_in(crs: str, unit_m: float | None, what: str) -> tuple[float, list[str]]:
    """By what to divide eastings and northings in metres for those of the system, and what to say of it.

    A foot that is not named more closely is that of the system, where this is one: 2 ppm are metres a long way from 0.

    Args:
        crs: reference system, "EPSG:nnnn" or "local".
        unit_m: metres of the unit in which they were surveyed; None: that of the system, in which they still are.
        what: was surveyed, as "control points".

    Raises:
        InputError: the system is unknown, or has longitudes and latitudes.
    """
    if unit_m is None:
        return 1.0, []
    of_crs = metres_per_unit(crs)
    if unit_m != FOOT_M or of_crs == unit_m or abs(of_crs / unit_m - 1) > _FEET_APART:
        return of_crs, []
    return unit_m, [f"the feet of the {what} are taken for those of {crs}, of {of_crs:.9f} m"]
