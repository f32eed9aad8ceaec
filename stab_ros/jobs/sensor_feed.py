"""The samples of a recording, told to the engine."""

from __future__ import annotations

import math

import numpy as np

from stab_ros.georeferencing.georeferencer import Georeferencer
from stab_ros.georeferencing.samples import AttitudeSample
from stab_ros.io.sensors import Sensors


def feed(engine: Georeferencer, sensors: Sensors) -> None:
    """Tells all samples; fixes without a height are left out, as a doubt of theirs says.

    Raises:
        InputError: a fix is too far from the origin of the map.
    """
    for fix in sensors.fixes:
        if math.isfinite(fix.height_m):
            engine.add_fix(fix.stamp_ns, np.array([fix.latitude_deg, fix.longitude_deg, fix.height_m]),
                           fix.covariance_m2)
    for attitude in sensors.attitudes:
        engine.add_attitude(AttitudeSample(attitude.stamp_ns, attitude.map_q_body, attitude.covariance_rad2))
    for level in sensors.water_levels:
        engine.set_water_level(level.stamp_ns, level.wse_m)
