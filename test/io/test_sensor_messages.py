"""Messages of sensors as other nodes send them (serialised by ROS itself), and ours as ROS and rosbags read them."""

from __future__ import annotations

import contextlib
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from geometry_msgs.msg import PointStamped, PoseWithCovarianceStamped, QuaternionStamped, TwistWithCovarianceStamped
from hypothesis import given, settings
from hypothesis import strategies as st
from message_makers import HEADER, complaint, damaged
from rclpy.serialization import deserialize_message, serialize_message
from rosbags.typesys import Stores, get_typestore
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import Imu, NavSatFix, NavSatStatus
from std_msgs.msg import Float64
from visualization_msgs.msg import Marker, MarkerArray

from stab_ros.core.errors import MessageError
from stab_ros.georeferencing.camera_twist import Twist
from stab_ros.georeferencing.control_points import ControlPoints
from stab_ros.imaging.pose import Pose
from stab_ros.io.attitude_message import Attitude, imu_cdr, quaternion_cdr, read_attitude
from stab_ros.io.cdr import FLOAT64, IMU, NAV_SAT_FIX, POINT_STAMPED, QUATERNION_STAMPED, TF_MESSAGE
from stab_ros.io.fix_message import GBAS_FIX, UNKNOWN_STATUS, Fix, fix_cdr, read_fix
from stab_ros.io.marker_message import gcps_cdr
from stab_ros.io.pose_message import pose_cdr
from stab_ros.io.transform_message import read_children, transform_cdr
from stab_ros.io.twist_message import twist_cdr
from stab_ros.io.water_level_message import read_water_level

COVARIANCE = np.array([[4.0, 1, 0.5], [1, 9, -2], [0.5, -2, 16]])
FIX = Fix(HEADER.stamp_ns, 55.123456789, -1.987654321, 87.25, COVARIANCE, GBAS_FIX, "gps")
Q = np.array([0.1, -0.2, 0.3, math.sqrt(1 - 0.14)])
ATTITUDE = Attitude(HEADER.stamp_ns, Q, COVARIANCE * 1e-6, "gimbal")


def nav_sat_fix(**fields: Any) -> bytes:
    message = NavSatFix(latitude=55.0, longitude=-1.5, altitude=80.0, position_covariance=COVARIANCE.ravel(),
                        position_covariance_type=NavSatFix.COVARIANCE_TYPE_KNOWN)
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(HEADER.stamp_ns, 10**9)
    message.header.frame_id = "gps"
    message.status.status = fields.pop("status", NavSatStatus.STATUS_FIX)
    for name, value in fields.items():
        setattr(message, name, value)
    return bytes(serialize_message(message))


def imu(q: tuple[float, ...] = (0.0, 0.0, 0.0, 1.0), covariance: np.ndarray = COVARIANCE) -> bytes:
    message = Imu(orientation_covariance=covariance.ravel())
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(HEADER.stamp_ns, 10**9)
    o = message.orientation
    o.x, o.y, o.z, o.w = q
    return bytes(serialize_message(message))


def test_fix_is_read() -> None:
    fix = read_fix(nav_sat_fix(status=NavSatStatus.STATUS_GBAS_FIX))
    assert (fix.stamp_ns, fix.latitude_deg, fix.longitude_deg, fix.height_m) == (HEADER.stamp_ns, 55.0, -1.5, 80.0)
    assert (fix.status, fix.frame_id, fix.fault, fix.doubt) == (GBAS_FIX, "gps", "", "")
    np.testing.assert_array_equal(fix.covariance_m2, COVARIANCE)


@pytest.mark.parametrize(("fields", "fault"), [
    ({"status": NavSatStatus.STATUS_NO_FIX}, "there is no fix"),
    ({"latitude": math.nan}, "not finite"),
    ({"longitude": math.inf}, "not finite"),
    ({"latitude": 0.0, "longitude": 0.0}, "before the first fix"),
    ({"latitude": 149.0, "longitude": -20.0}, "may be swapped"),
    ({"latitude": 95.0, "longitude": 120.0}, "must lie within 90 degrees"),
    ({"longitude": 361.0}, "must lie within 360 degrees")])
def test_fix_that_is_no_position_says_why(fields: dict[str, Any], fault: str) -> None:
    assert fault in read_fix(nav_sat_fix(**fields)).fault


@pytest.mark.parametrize(("fields", "doubt"), [
    ({"position_covariance_type": NavSatFix.COVARIANCE_TYPE_UNKNOWN}, "covariance is unknown (type 0)"),
    ({"position_covariance": np.zeros(9)}, "unknown (all zero)"),
    ({"position_covariance": np.full(9, np.nan)}, "not finite"),
    ({"position_covariance": -np.eye(3).ravel()}, "symmetric and not negative"),
    ({"position_covariance": np.arange(1.0, 10)}, "symmetric and not negative")])
def test_fix_without_covariance_says_so(fields: dict[str, Any], doubt: str) -> None:
    fix = read_fix(nav_sat_fix(**fields))
    assert fix.covariance_m2 is None
    assert (fix.fault, doubt in fix.doubt) == ("", True)


def test_fix_of_unknown_status_or_altitude_is_a_position_in_doubt() -> None:
    fix = read_fix(nav_sat_fix(status=UNKNOWN_STATUS, altitude=math.nan))
    assert (fix.fault, fix.doubt) == ("", "its status is unknown, it has no altitude")


def test_written_fix_is_read_by_ros_and_by_rosbags() -> None:
    cdr = fix_cdr(FIX)
    by_ros = deserialize_message(cdr, NavSatFix)
    by_rosbags: Any = get_typestore(Stores.ROS2_JAZZY).deserialize_cdr(cdr, NAV_SAT_FIX)
    for message in (by_ros, by_rosbags):
        assert (message.latitude, message.longitude, message.altitude) == (FIX.latitude_deg, FIX.longitude_deg, 87.25)
        assert (message.status.status, message.position_covariance_type) == (2, 3)
        np.testing.assert_array_equal(np.array(message.position_covariance).reshape(3, 3), COVARIANCE)
    assert read_fix(fix_cdr(replace(FIX, covariance_m2=None))).doubt == "its covariance is unknown (type 0)"


def test_attitude_of_an_imu_is_read_and_normalised() -> None:
    attitude = read_attitude(imu(tuple(1.005 * Q)), IMU)
    np.testing.assert_allclose(attitude.map_q_body, Q, atol=1e-15)
    np.testing.assert_array_equal(attitude.covariance_rad2, COVARIANCE)
    assert (attitude.stamp_ns, attitude.fault, attitude.doubt) == (HEADER.stamp_ns, "", "")


@pytest.mark.parametrize(("q", "covariance", "fault"), [
    ((0.0, 0.0, 0.0, 0.0), COVARIANCE, "all zero"), ((0.0, math.nan, 0.0, 1.0), COVARIANCE, "not finite"),
    ((0.0, 0.0, 0.0, 2.0), COVARIANCE, "length 2"), ((1e300, 0.0, 1e300, 0.0), COVARIANCE, "length inf"),
    ((0.0, 0.0, 0.0, 1.0), -np.eye(3), "measures no orientation")])
def test_imu_without_attitude_says_why(q: tuple[float, ...], covariance: np.ndarray, fault: str) -> None:
    assert fault in read_attitude(imu(q, covariance), IMU).fault


def test_attitude_of_an_optical_frame_is_doubted() -> None:
    message = quaternion_cdr(replace(ATTITUDE, frame_id="drone/camera_optical_frame"))
    attitude = read_attitude(message, QUATERNION_STAMPED)
    assert attitude.doubt == ("its frame_id drone/camera_optical_frame is that of an optical frame, it is taken for "
                              "x forward, y left, z up")


def test_written_attitude_is_read_by_ros() -> None:
    message = deserialize_message(imu_cdr(ATTITUDE), Imu)
    o = message.orientation
    assert (o.x, o.y, o.z, o.w) == tuple(Q)
    np.testing.assert_array_equal(message.orientation_covariance.reshape(3, 3), COVARIANCE * 1e-6)
    assert message.angular_velocity_covariance[0] == message.linear_acceleration_covariance[0] == -1
    stamped = deserialize_message(quaternion_cdr(ATTITUDE), QuaternionStamped)
    assert (stamped.header.frame_id, stamped.quaternion.z) == ("gimbal", Q[2])
    again = read_attitude(quaternion_cdr(ATTITUDE), QUATERNION_STAMPED)
    np.testing.assert_allclose(again.map_q_body, Q, atol=1e-16)
    assert (again.covariance_rad2, again.fault) == (None, "")


def test_attitude_of_another_type_is_refused() -> None:
    with pytest.raises(MessageError, match="holds no attitude, it must be sensor_msgs/msg/Imu or"):
        read_attitude(nav_sat_fix(), NAV_SAT_FIX)


def test_water_level_is_a_number_or_the_height_of_a_point() -> None:
    number = read_water_level(bytes(serialize_message(Float64(data=12.5))), FLOAT64, 7)
    assert (number.stamp_ns, number.wse_m, number.fault) == (7, 12.5, "")
    point = PointStamped()
    point.header.stamp.sec, point.header.frame_id, point.point.z = 3, "map", -1.25
    level = read_water_level(bytes(serialize_message(point)), POINT_STAMPED, 7)
    assert (level.stamp_ns, level.wse_m, level.frame_id) == (3 * 10**9, -1.25, "map")
    assert "not finite" in read_water_level(bytes(serialize_message(Float64(data=math.nan))), FLOAT64, 7).fault
    with pytest.raises(MessageError, match="holds no water level"):
        read_water_level(imu(), IMU, 7)


def test_written_pose_is_read_by_ros() -> None:
    pose = Pose.of_angles(np.array([1.5, -2.5, 46.0]), 0.3, 1.2, 0.1)
    covariance = np.arange(36.0).reshape(6, 6)
    message = deserialize_message(pose_cdr(pose, covariance, HEADER), PoseWithCovarianceStamped)
    place, q = message.pose.pose.position, message.pose.pose.orientation
    assert (place.x, place.y, place.z, message.header.frame_id) == (1.5, -2.5, 46.0, HEADER.frame_id)
    again = Pose.of_quaternion(pose.position_m, np.array([q.x, q.y, q.z, q.w]))
    np.testing.assert_allclose(again.cam_R_map, pose.cam_R_map, atol=1e-15)
    np.testing.assert_array_equal(message.pose.covariance.reshape(6, 6), covariance)
    assert not deserialize_message(pose_cdr(pose, None, HEADER), PoseWithCovarianceStamped).pose.covariance.any()


def test_a_written_twist_is_read_by_ros() -> None:
    covariance = np.arange(36.0).reshape(6, 6)
    twist = Twist(np.array([1.5, -2, 0.25]), np.array([0.1, 0.2, -0.3]), covariance)
    message = deserialize_message(twist_cdr(twist, HEADER), TwistWithCovarianceStamped)
    linear, angular = message.twist.twist.linear, message.twist.twist.angular
    assert (linear.x, linear.y, linear.z, angular.x, angular.y, angular.z) == (1.5, -2, 0.25, 0.1, 0.2, -0.3)
    assert message.header.frame_id == HEADER.frame_id
    np.testing.assert_array_equal(message.twist.covariance.reshape(6, 6), covariance)


def test_a_written_transform_takes_points_of_the_camera_to_the_map() -> None:
    """As tf2 does with it: rotate, then translate; read by rosbags."""
    pose = Pose.of_angles(np.array([1.5, -2.5, 46.0]), 0.3, 1.2, 0.1)
    data, store = transform_cdr(pose, HEADER, "cam_optical"), get_typestore(Stores.ROS2_JAZZY)
    message: Any = store.deserialize_cdr(data, TF_MESSAGE)
    (stamped,) = message.transforms
    q, place = stamped.transform.rotation, stamped.transform.translation
    in_camera = np.array([[1.0, 2, 30], [-3, 0, 40]])
    in_map = Rotation.from_quat([q.x, q.y, q.z, q.w]).apply(in_camera) + np.array([place.x, place.y, place.z])
    np.testing.assert_allclose(pose.to_camera(in_map), in_camera, atol=1e-12)
    assert (stamped.header.frame_id, stamped.child_frame_id) == (HEADER.frame_id, "cam_optical")
    assert read_children(data) == {"cam_optical"}


@given(data=damaged(transform_cdr(Pose.of_angles(np.array([1.5, -2.5, 46.0]), 0.3, 1.2, 0.1), HEADER, "cam_optical")))
@settings(max_examples=50)
def test_damaged_transforms_are_refused_or_read(data: bytes) -> None:
    with contextlib.suppress(MessageError):
        assert all(isinstance(one, str) for one in read_children(data))


def test_written_markers_are_read_by_ros() -> None:
    points = ControlPoints(("A", "Bé"), np.zeros((2, 2)), np.array([[1.0, 2, 3], [4, 5, 6]]))
    first, *markers = deserialize_message(gcps_cdr(points, {"Bé"}, 0.5, HEADER), MarkerArray).markers
    assert first.action == Marker.DELETEALL
    balls, texts = markers[::2], markers[1::2]
    assert [ball.pose.position.z for ball in balls] == [3, 6]
    assert [text.text for text in texts] == ["A", "Bé"]
    assert [ball.color.g > ball.color.r for ball in balls] == [True, False]
    assert len({(marker.ns, marker.id) for marker in markers}) == 4


@settings(max_examples=150, deadline=None, derandomize=True)
@given(data=st.data())
def test_no_damage_raises_anything_but_message_error(data: st.DataObject) -> None:
    assert len(complaint(read_fix, data.draw(damaged(nav_sat_fix()))).splitlines()) <= 1
    broken = data.draw(damaged(imu()))
    assert len(complaint(lambda cdr: read_attitude(cdr, IMU), broken).splitlines()) <= 1
