"""The samples of sensors, as messages tell them, told to the engine: by the command and by the node."""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np

from stab_ros.georeferencing.georeferencer import Georeferencer
from stab_ros.georeferencing.samples import AttitudeSample
from stab_ros.io.attitude_message import Attitude
from stab_ros.io.fix_message import Fix
from stab_ros.io.sensors import Sensors
from stab_ros.io.water_level_message import WaterLevel

Sample: TypeAlias = Fix | Attitude | WaterLevel


def feed(engine: Georeferencer, sensors: Sensors) -> None:
    """Tells all samples of a recording.

    Raises:
        InputError: as `tell`.
    """
    samples: list[Sample] = [*sensors.fixes, *sensors.attitudes, *sensors.water_levels]
    for sample in samples:
        tell(engine, sample)


def tell(engine: Georeferencer, sample: Sample) -> None:
    """Tells one sample; a fix without a height is left out, as a doubt of it says.

    Raises:
        InputError: a fix is too far from the origin of the map.
    """
    if isinstance(sample, WaterLevel):
        engine.set_water_level(sample.stamp_ns, sample.wse_m)
    elif isinstance(sample, Attitude):
        engine.add_attitude(AttitudeSample(sample.stamp_ns, sample.map_q_body, sample.covariance_rad2))
    elif math.isfinite(sample.height_m):
        engine.add_fix(sample.stamp_ns, np.array([sample.latitude_deg, sample.longitude_deg, sample.height_m]),
                       sample.covariance_m2)
