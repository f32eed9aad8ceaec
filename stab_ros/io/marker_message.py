"""visualization_msgs/MarkerArray: control points and velocities as RViz and Foxglove draw them."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

import numpy as np
from rosbags.typesys.stores import ros2_jazzy as ros

from stab_ros.core.types import FloatArray
from stab_ros.georeferencing.control_points import ControlPoints
from stab_ros.io.attitude_message import quaternion_message
from stab_ros.io.cdr import MARKER_ARRAY, Header, header_message, serialize
from stab_ros.io.pose_message import point_message

_Marker = ros.visualization_msgs__msg__Marker
_USED, _REJECTED, _TEXT = (0.1, 0.8, 0.2), (0.9, 0.1, 0.1), (1.0, 1.0, 1.0)  # red, green, blue
_UPRIGHT = np.array([0.0, 0, 0, 1])


def gcps_cdr(points: ControlPoints, rejected: Collection[str], size_m: float, header: Header) -> bytes:
    """Each point as a ball, green or, where `rejected` has its name, red, with its name above; older ones are deleted.

    size_m: diameter of a ball.
    """
    # Any: rosbags types the array as one of Dashing, whose markers are fewer
    markers: list[Any] = [_cleared(header, "gcps")]
    above = np.array([0, 0, 1.2 * size_m])
    for number, (name, place) in enumerate(zip(points.names, points.map_m, strict=True)):
        colour = _REJECTED if name in rejected else _USED
        markers.append(_marker(header, "gcps", number, _Marker.ADD, _Marker.SPHERE, place, size_m, colour))
        text = _marker(header, "names", number, _Marker.ADD, _Marker.TEXT_VIEW_FACING, place + above, size_m, _TEXT)
        text.text = name
        markers.append(text)
    return serialize(ros.visualization_msgs__msg__MarkerArray(markers=markers), MARKER_ARRAY)


def arrows_cdr(starts: FloatArray, ends: FloatArray, colours: FloatArray, width: float, header: Header) -> bytes:
    """Arrows that take the place of those before.

    Args:
        starts: (N, 3).
        ends: (N, 3).
        colours: (N, 3), red, green and blue, 0 to 1.
        width: of the shaft.
        header: of the frame of the places.
    """
    markers: list[Any] = [_cleared(header, "velocity")]
    for number, (start, end, colour) in enumerate(zip(starts, ends, colours.tolist(), strict=True)):
        arrow = _marker(header, "velocity", number, _Marker.ADD, _Marker.ARROW, np.zeros(3), width, tuple(colour))
        arrow.points = [point_message(start), point_message(end)]
        arrow.scale.y, arrow.scale.z = 2.5 * width, 0.0  # of the head: its diameter, and its length by default
        markers.append(arrow)
    return serialize(ros.visualization_msgs__msg__MarkerArray(markers=markers), MARKER_ARRAY)


def _cleared(header: Header, namespace: str) -> _Marker:
    """Deletes all markers of a message before."""
    return _marker(header, namespace, 0, _Marker.DELETEALL, _Marker.SPHERE, np.zeros(3), 1.0, _USED)


def _marker(header: Header, namespace: str, number: int, action: int, kind: int, place_m: FloatArray, size_m: float,
            colour: tuple[float, float, float]) -> _Marker:
    red, green, blue = colour
    return _Marker(
        header=header_message(header), ns=namespace, id=number, type=kind, action=action,
        pose=ros.geometry_msgs__msg__Pose(position=point_message(place_m), orientation=quaternion_message(_UPRIGHT)),
        scale=ros.geometry_msgs__msg__Vector3(x=size_m, y=size_m, z=size_m),
        color=ros.std_msgs__msg__ColorRGBA(r=red, g=green, b=blue, a=1.0),
        lifetime=ros.builtin_interfaces__msg__Duration(sec=0, nanosec=0), frame_locked=False, points=[], colors=[],
        texture_resource="", uv_coordinates=[], text="", mesh_resource="", mesh_use_embedded_materials=False,
        texture=ros.sensor_msgs__msg__CompressedImage(
            header=header_message(Header(0)), format="", data=np.empty(0, np.uint8)),
        mesh_file=ros.visualization_msgs__msg__MeshFile(filename="", data=np.empty(0, np.uint8)))
