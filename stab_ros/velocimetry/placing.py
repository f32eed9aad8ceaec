"""From the answer of georeferencing to a frame as methods take it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stab_ros.core.geometry import normalized, product_jacobians
from stab_ros.core.types import Gray, Homography
from stab_ros.georeferencing.place_error import PlaceError
from stab_ros.georeferencing.placement import Motion, Placement
from stab_ros.imaging.camera import Camera
from stab_ros.velocimetry.pixel_plane import TURNED
from stab_ros.velocimetry.placed_frame import PlacedFrame
from stab_ros.velocimetry.vectors import Unit

_EXACT = PlaceError(np.zeros((8, 8)), np.zeros((8, 0)))


@dataclass(frozen=True, eq=False)
class Picture:
    """The picture of a frame in which velocities are measured: as taken, stabilised, or an orthophoto.

    Attributes:
        gray: (h, w) uint8.
        cur_H_picture: (3, 3), from its undistorted pixels to those of the frame as taken.
        camera: whose lens distortion it has; None: it has none.
    """

    gray: Gray
    cur_H_picture: Homography
    camera: Camera | None = None


def placed_frame(stamp_ns: int, placement: Placement, picture: Picture, motion: Motion | None,
                 unit: Unit = "m") -> PlacedFrame:
    """The frame with its place and the error of it.

    A picture that was warped by the homography of the frame shows the same pixels elsewhere: where they lie on the
    plane, and how sure that is, does not change by it.

    Args:
        stamp_ns: of the frame.
        placement: of the frame as taken; that of `PixelPlane` for pixels.
        picture: what shows it.
        motion: how the frame lies to the reference; None: unknown.
        unit: of the plane.
    """
    plane_H_cur, error = placement.map_H_image, placement.error or _EXACT
    if unit == "px":
        plane_H_cur, error = TURNED @ plane_H_cur, error.mapped(product_jacobians(TURNED, plane_H_cur)[1])
    error = error.mapped(product_jacobians(plane_H_cur, picture.cur_H_picture)[0])
    return PlacedFrame(stamp_ns, picture.gray, normalized(plane_H_cur @ picture.cur_H_picture), error.own, error.shared,
                       picture.camera, epoch_of(motion))


def epoch_of(motion: Motion | None) -> int:
    """Frames of different epochs have different references."""
    return 0 if motion is None else motion.reset_counter


def plane_H_ref(placement: Placement, motion: Motion | None, unit: Unit = "m") -> Homography:
    """From pixels of the reference to the plane; those of the frame itself where there is no homography of it."""
    H = placement.map_H_image if motion is None else placement.map_H_image @ np.linalg.inv(motion.ref_H_cur)
    return normalized(TURNED @ H if unit == "px" else H)
