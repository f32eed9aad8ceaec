"""The orientation without georeference: the plane is the reference image, and lengths are its pixels.

A map is north up, an image y down; so the plane that georeferencing sees has y turned, and `placing` turns it back.
"""

from __future__ import annotations

import numpy as np

from stab_ros.core.geometry import product_jacobians
from stab_ros.core.types import Homography
from stab_ros.georeferencing.orientation import Answer, Unplaced
from stab_ros.georeferencing.place_error import PlaceError
from stab_ros.georeferencing.placement import Placement, Sighting

TURNED: Homography = np.diag([1.0, -1.0, 1.0])  # from y down to y up, and back


class PixelPlane:
    """A frame lies in the reference where its homography tells."""

    needs_motion = True
    needs_sensors = False

    def place(self, sighting: Sighting) -> Answer:
        """The homography, y up."""
        if sighting.ref_H_cur is None:
            return Unplaced("the frame is lost, there is no homography of it")
        error = None
        if sighting.covariance is not None:
            error = PlaceError(sighting.covariance, np.zeros((8, 0))).mapped(
                product_jacobians(TURNED, sighting.ref_H_cur)[1])
        return Placement(TURNED @ sighting.ref_H_cur, error)
