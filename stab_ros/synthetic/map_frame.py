"""The renderer's world in the map frame, and poses in the map over time.

The world of `camera_path` has x to the right and y to the bottom of a nominal image and z into the ground; the map has
x east, y north and z up (REP-103). Both have their origin on the ground below the nominal camera: the top of a nominal
image is north, (x, y, z) of the world is (x, -y, -z) of the map.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import numpy as np

from stab_ros.core.types import FloatArray
from stab_ros.imaging.camera import Camera
from stab_ros.imaging.pose import Pose
from stab_ros.synthetic import camera_path

PosesOverTime: TypeAlias = Callable[[float], Pose]  # of seconds since frame 0

MAP_R_WORLD: FloatArray = np.diag([1.0, -1.0, -1.0])  # its own inverse
MAP_R_WORLD.flags.writeable = False


def map_pose(pose: camera_path.Pose) -> Pose:
    """The same pose in the map."""
    return Pose(np.array([pose.x_m, -pose.y_m, pose.height_m]), camera_path.rotation(pose) @ MAP_R_WORLD)


def map_points(ground_m: FloatArray) -> FloatArray:
    """Points (N, 3) of the map, m, of ground points (N, 2), x and y of the world."""
    return np.asarray(np.column_stack([ground_m, np.zeros(len(ground_m))]) @ MAP_R_WORLD)


def camera_of(pinhole: camera_path.PinholeCamera) -> Camera:
    """The same camera as sensor_msgs/CameraInfo describes it."""
    return Camera(pinhole.K, np.zeros(5), "plumb_bob", pinhole.size)
