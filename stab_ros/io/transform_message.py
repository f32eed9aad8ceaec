"""tf2_msgs/TFMessage: where the frame of the camera is in the map, as tf2's TransformBroadcaster sends it."""

from __future__ import annotations

from typing import cast

from rosbags.typesys.stores import ros2_jazzy as ros

from stab_ros.imaging.pose import Pose
from stab_ros.io.attitude_message import quaternion_message
from stab_ros.io.cdr import TF_MESSAGE, Header, deserialize, header_message, serialize
from stab_ros.io.twist_message import vector_message


def transform_cdr(pose: Pose, header: Header, child_frame_id: str) -> bytes:
    """One transform, from the camera's optical frame `child_frame_id` to the frame of the header."""
    transform = ros.geometry_msgs__msg__Transform(
        translation=vector_message(pose.position_m), rotation=quaternion_message(pose.map_q_optical))
    stamped = ros.geometry_msgs__msg__TransformStamped(
        header=header_message(header), child_frame_id=child_frame_id, transform=transform)
    return serialize(ros.tf2_msgs__msg__TFMessage(transforms=[stamped]), TF_MESSAGE)


def read_children(cdr: bytes | memoryview) -> set[str]:
    """The frames whose place the transforms of a message tell.

    Raises:
        MessageError: damaged.
    """
    message = cast(ros.tf2_msgs__msg__TFMessage, deserialize(cdr, TF_MESSAGE))
    return {transform.child_frame_id for transform in message.transforms}
