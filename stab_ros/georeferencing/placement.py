"""What an orientation tells of a frame: where it lies on the water plane."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from stab_ros.core.types import FloatArray, Gray, Homography
from stab_ros.georeferencing.place_error import PlaceError
from stab_ros.georeferencing.pose_link import PoseLink
from stab_ros.imaging.pose import Pose

NO_PICTURE: Gray = np.zeros((0, 0), np.uint8)


@dataclass(frozen=True, eq=False)
class Motion:
    """How a frame lies to the reference of the stabiliser.

    Attributes:
        ref_H_cur: (3, 3), h22 = 1, from its undistorted pixels to those of the reference.
        covariance: (8, 8) of h00 .. h21; None: unknown.
        reset_counter: how often the reference had been replaced.
    """

    ref_H_cur: Homography
    covariance: FloatArray | None = None
    reset_counter: int = 0


@dataclass(frozen=True, eq=False)
class Sighting:
    """A frame as orientations take it.

    Attributes:
        stamp_ns: when the image was taken.
        gray: (h, w) uint8, the image as taken; `NO_PICTURE` for an orientation that does not look at it.
        ref_H_cur: (3, 3), from its undistorted pixels to those of the reference; None: lost, or not stabilised.
        covariance: (8, 8) of h00 .. h21; None: unknown.
        wse_m: water surface elevation in the map.
        wse_sigma_m: its standard deviation.
        reset_counter: how often the reference had been replaced.
        size: width and height of the image, px.
    """

    stamp_ns: int
    gray: Gray
    ref_H_cur: Homography | None = None
    covariance: FloatArray | None = None
    wse_m: float = 0.0
    wse_sigma_m: float = 0.0
    reset_counter: int = 0
    size: tuple[int, int] = (0, 0)


@dataclass(frozen=True, eq=False)
class Placement:
    """Where a frame lies.

    Attributes:
        map_H_image: (3, 3), h22 = 1, from undistorted pixels to east and north on the water plane, m.
        error: of h00 .. h21; None: unknown.
        pose: of the camera; None: the orientation does not know it.
        pose_covariance: (6, 6) of east, north, up, m, and rotations about the axes of the map, rad, as in
            geometry_msgs/PoseWithCovariance; None: unknown.
        values: figures for the status by name, with unit in the name (rmse_px, rmse_m, gsd_m, ...).
        warnings: what makes the answer doubtful: one line each.
        rejected: names of control points that were left out.
        worst_point: name of the control point with the largest residual; "": there are none.
        pose_link: what the pose has in common with those of other frames; None: its changes are no motion, as where the
            camera is taken to be still.
    """

    map_H_image: Homography
    error: PlaceError | None = None
    pose: Pose | None = None
    pose_covariance: FloatArray | None = None
    values: Mapping[str, float] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    rejected: tuple[str, ...] = ()
    worst_point: str = ""
    pose_link: PoseLink | None = None

    @property
    def covariance(self) -> FloatArray | None:
        """(8, 8) of h00 .. h21; None: unknown."""
        return None if self.error is None else self.error.covariance
