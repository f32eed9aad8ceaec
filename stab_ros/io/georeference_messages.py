"""What georeferencing tells of a frame, as messages: place, motion, status; the same bytes live and offline."""

from __future__ import annotations

from stab_ros.core.text import number
from stab_ros.georeferencing.control_points import ControlPoints
from stab_ros.georeferencing.georeferencer import Georeferenced
from stab_ros.georeferencing.local_frame import LocalFrame
from stab_ros.imaging.camera import Camera
from stab_ros.io.cdr import Header, header_of
from stab_ros.io.diagnostics_message import OK, WARN, status_cdr
from stab_ros.io.fix_message import Fix, fix_cdr
from stab_ros.io.homography_message import rectification_cdr
from stab_ros.io.marker_message import gcps_cdr
from stab_ros.io.pose_message import pose_cdr
from stab_ros.io.transform_message import transform_cdr
from stab_ros.io.twist_message import twist_cdr

MAP_FRAME = "map"
_MARKER_PX = 20.0  # diameter of the balls that mark control points, in pixels of the orthophoto


def map_header(answer: Georeferenced) -> Header:
    """The header of what is told in the map at the time of a frame."""
    return Header(answer.frame.stamp_ns, MAP_FRAME)


def pose_of_cdr(answer: Georeferenced) -> bytes | None:
    """PoseWithCovarianceStamped of the camera in the map; None: its pose is not known."""
    placement = answer.placement
    if placement is None or placement.pose is None:
        return None
    return pose_cdr(placement.pose, placement.pose_covariance, map_header(answer))


def motion_cdr(answer: Georeferenced) -> bytes | None:
    """TwistWithCovarianceStamped of the camera in its own optical frame; None: see `Georeferenced.twist`."""
    twist = answer.twist
    return None if twist is None else twist_cdr(twist, header_of(answer.frame))


def camera_transform_cdr(answer: Georeferenced) -> bytes | None:
    """TFMessage from the map to the frame of the image; None: its pose is not known, or the frame has no name."""
    placement = answer.placement
    if placement is None or placement.pose is None or not answer.frame.frame_id:
        return None
    return transform_cdr(placement.pose, map_header(answer), answer.frame.frame_id)


def ortho_info_cdr(answer: Georeferenced, camera: Camera | None) -> bytes:
    """CameraInfo with the homography from undistorted pixels of the image to those of `image_ortho`; zeros: unplaced.

    camera: of the image; None: its K is not known.
    """
    size = (0, 0) if answer.grid is None else answer.grid.size
    return rectification_cdr(answer.ortho_H_image, header_of(answer.frame), size, camera)


def origin_cdr(answer: Georeferenced, origin: LocalFrame) -> bytes:
    """NavSatFix of the origin of the map."""
    return origin_of_map_cdr(answer.frame.stamp_ns, origin)


def origin_of_map_cdr(stamp_ns: int, origin: LocalFrame) -> bytes:
    """NavSatFix of the origin of the map, as it is known at this stamp."""
    return fix_cdr(Fix(stamp_ns, origin.latitude_deg, origin.longitude_deg, origin.height_m, frame_id=MAP_FRAME))


def gcps_of_cdr(answer: Georeferenced, gcps: ControlPoints) -> bytes:
    """MarkerArray of control points; those that were left out for this frame are red."""
    rejected = () if answer.placement is None else answer.placement.rejected
    size_m = 1.0 if answer.grid is None else _MARKER_PX * answer.grid.resolution_m
    return gcps_cdr(gcps, rejected, size_m, map_header(answer))


def georeference_values(answer: Georeferenced, orientation: str) -> dict[str, str]:
    """Keys and values of `~/status`; empty strings: not known."""
    placement, grid = answer.placement, answer.grid
    west_m, north_m, resolution_m = (None,) * 3 if grid is None else (grid.west_m, grid.north_m, grid.resolution_m)
    values = {
        "state": "UNPLACED" if placement is None else "PLACED",
        "orientation": orientation,
        "reason": answer.reason,
        "wse_m": number(answer.wse_m),
        "resolution_m": number(resolution_m),
        "west_m": number(west_m),
        "north_m": number(north_m),
    }
    if placement is None:
        return values
    return {**values, **{key: number(value) for key, value in placement.values.items()},
            "worst_point": placement.worst_point, "rejected": ", ".join(placement.rejected),
            "warnings": "; ".join(placement.warnings)}


def georeference_status_cdr(answer: Georeferenced, orientation: str) -> bytes:
    """DiagnosticArray of a frame: WARN where it is unplaced or its place is doubtful."""
    values, placement = georeference_values(answer, orientation), answer.placement
    fine = placement is not None and not placement.warnings
    return status_cdr(header_of(answer.frame), "georeference", answer.frame.frame_id, OK if fine else WARN,
                      answer.reason or values["warnings"] or "PLACED", values)
