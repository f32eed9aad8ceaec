"""Whether a camera that is taken for a still one moves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from stab_ros.core.geometry import rms_distance
from stab_ros.georeferencing.orientation import Answer
from stab_ros.georeferencing.placement import Placement, Sighting

_MOST_PX = 2.0  # of motion; more is warned of


def with_movement(answer: Answer, sighting: Sighting) -> Answer:
    """The answer, with a warning where the homography of the frame tells that the camera has moved."""
    if not isinstance(answer, Placement) or sighting.ref_H_cur is None:
        return answer
    moved_px = rms_distance(sighting.ref_H_cur, np.eye(3), sighting.size)
    if moved_px < _MOST_PX:
        return answer
    doubt = "the camera is not still, its homographies tell of motion; choose an orientation of a moving camera"
    return replace(answer, values={**answer.values, "moved_px": moved_px}, warnings=(*answer.warnings, doubt))
