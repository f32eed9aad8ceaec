"""The message on `homography`, against the real ROS 2 (rclpy) and OpenCV's rectification."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from message_makers import HEADER, complaint, damaged
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import CameraInfo

from stab_ros.core.errors import MessageError
from stab_ros.core.types import FloatArray, LostReason, State, Track
from stab_ros.imaging.camera import Camera
from stab_ros.io.homography_message import homography_cdr, read_homography

SIZE = (640, 480)
K = np.array([[800.0, 0.0, 321.5], [0.0, 805.0, 238.25], [0.0, 0.0, 1.0]])
PLUMB_BOB = Camera(K, np.array([-0.2, 0.05, 1e-3, -1e-3, 0.01]), "plumb_bob", SIZE)
TILTED = np.array([[1.01, 0.02, -7.3], [-0.015, 0.99, 4.6], [1e-5, -2e-5, 1.0]])


def track(H: FloatArray | None) -> Track:
    if H is None:
        return Track(State.LOST, 3, HEADER.stamp_ns, 5, 1, 40, lost_reason=LostReason.FEW_INLIERS)
    return Track(State.TRACKED, 3, HEADER.stamp_ns, 5, 1, 40, 38, H, np.arange(64.0).reshape(8, 8) / 7, 0.1, 0.02)


def rectification(cdr: bytes) -> tuple[CameraInfo, FloatArray, FloatArray, FloatArray]:
    message = deserialize_message(cdr, CameraInfo)
    return message, np.reshape(message.k, (3, 3)), np.reshape(message.r, (3, 3)), np.reshape(message.p, (3, 4))


homographies = st.tuples(*[st.floats(-s, s) for s in (0.3, 0.3, 300, 0.3, 0.3, 300, 1e-4, 1e-4)]).map(
    lambda d: np.eye(3) + np.reshape([*d, 0.0], (3, 3)))
calibrations = st.tuples(st.floats(300, 5000), st.floats(300, 5000), st.floats(0, 4096), st.floats(0, 2160)).map(
    lambda v: Camera(np.array([[v[0], 0, v[2]], [0, v[1], v[3]], [0, 0, 1]]), np.zeros(0), "", SIZE))
cameras = st.one_of(st.none(), calibrations)


@settings(max_examples=200, deadline=None)
@given(H=homographies, camera=cameras)
def test_homography_is_p_r_k_inverse(H: FloatArray, camera: Camera | None) -> None:
    cdr = homography_cdr(track(H), HEADER, SIZE, camera)
    message, k, r, p = rectification(cdr)
    np.testing.assert_allclose(p[:, :3] @ r @ np.linalg.inv(k), H, rtol=1e-12, atol=1e-12 * np.abs(H).max())
    stamp_ns, read = read_homography(cdr)
    assert read is not None
    assert (stamp_ns, message.width, message.height) == (HEADER.stamp_ns, *SIZE)
    np.testing.assert_allclose(read, H, rtol=1e-12, atol=1e-12 * np.abs(H).max())
    assert not p[:, 3].any()


def test_homography_without_camera_is_exact() -> None:
    message, k, r, p = rectification(homography_cdr(track(TILTED), HEADER, SIZE))
    assert (k == np.eye(3)).all()
    assert (p == np.eye(3, 4)).all()
    assert (r == TILTED).all()
    np.testing.assert_array_equal(read_homography(homography_cdr(track(TILTED), HEADER, SIZE))[1], TILTED)
    assert message.distortion_model == "plumb_bob"
    assert list(message.d) == [1e-300, 0, 0, 0, 0]
    assert message.header.frame_id == "camera"


def test_homography_carries_the_cameras_distortion() -> None:
    rational = Camera(K, np.zeros(8), "rational_polynomial", SIZE)
    message, *_ = rectification(homography_cdr(track(TILTED), HEADER, SIZE, PLUMB_BOB))
    assert list(message.d) == list(PLUMB_BOB.D)
    message, *_ = rectification(homography_cdr(track(TILTED), HEADER, SIZE, rational))
    assert (message.distortion_model, list(message.d)) == ("rational_polynomial", [1e-300, *[0] * 7])
    assert not rational.D.any()  # the camera itself stays as it was


@pytest.mark.parametrize("camera", [None, PLUMB_BOB])
def test_lost_is_all_zero_and_still_stamped(camera: Camera | None) -> None:
    cdr = homography_cdr(track(None), HEADER, SIZE, camera)
    _, k, r, p = rectification(cdr)
    assert not np.any([*k.flat, *r.flat, *p.flat])
    assert read_homography(cdr) == (HEADER.stamp_ns, None)


def test_nan_never_leaves() -> None:
    with pytest.raises(ValueError, match="NaN"):
        homography_cdr(track(np.full((3, 3), np.nan)), HEADER, SIZE)


def texture(seed: int) -> np.ndarray:
    noise = np.random.default_rng(seed).normal(0, 1, (SIZE[1], SIZE[0])).astype(np.float32)
    smoothed = cv2.GaussianBlur(noise, (0, 0), 2)
    return np.asarray(np.clip(128 + 40 * smoothed / smoothed.std(), 0, 255).astype(np.uint8))


def rectified_like_image_proc(image: np.ndarray, cdr: bytes) -> np.ndarray:
    message, k, r, p = rectification(cdr)
    maps = cv2.initUndistortRectifyMap(k, np.array(message.d), r, p[:, :3], SIZE, cv2.CV_16SC2)
    return np.asarray(cv2.remap(image, maps[0], maps[1], cv2.INTER_LINEAR))


def assert_same_image(a: np.ndarray, b: np.ndarray, covered: np.ndarray) -> None:
    """Alike where `covered` is white, borders left out."""
    inside = cv2.erode(covered, np.ones((15, 15))) == 255
    difference = np.abs(a.astype(int) - b)[inside]
    assert inside.mean() > 0.8
    assert np.percentile(difference, 95) <= 1
    assert difference.max() <= 8


@pytest.mark.parametrize("camera", [None, Camera(K, np.zeros(5), "plumb_bob", SIZE)])
def test_image_proc_stabilises_with_it(camera: Camera | None) -> None:
    image, white = texture(4), np.full(SIZE[::-1], 255, np.uint8)
    rectified = rectified_like_image_proc(image, homography_cdr(track(TILTED), HEADER, SIZE, camera))
    assert_same_image(rectified, cv2.warpPerspective(image, TILTED, SIZE), cv2.warpPerspective(white, TILTED, SIZE))


def test_image_proc_undistorts_and_stabilises_with_it() -> None:
    image, white = texture(5), np.full(SIZE[::-1], 255, np.uint8)

    def in_two_steps(image: np.ndarray) -> np.ndarray:
        return np.asarray(cv2.warpPerspective(cv2.undistort(image, K, PLUMB_BOB.D), TILTED, SIZE))

    rectified = rectified_like_image_proc(image, homography_cdr(track(TILTED), HEADER, SIZE, PLUMB_BOB))
    # two interpolations blur more than one
    blurred = [cv2.GaussianBlur(image, (0, 0), 2) for image in (rectified, in_two_steps(image))]
    assert_same_image(blurred[0], blurred[1], in_two_steps(white))


@pytest.mark.parametrize("damage", [
    {"k": [0.0] * 9}, {"k": [1.0] * 9}, {"r": [np.nan] * 9}, {"r": [np.inf] * 9}, {"p": [0.0] * 12}, {"r": [0.0] * 9},
    {"r": [1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0]}])
def test_matrices_that_make_no_homography_are_refused(damage: dict[str, list[float]]) -> None:
    message, *_ = rectification(homography_cdr(track(TILTED), HEADER, SIZE))
    for name, values in damage.items():
        setattr(message, name, values)
    with pytest.raises(MessageError):
        read_homography(serialize_message(message))


@settings(max_examples=150, deadline=None, derandomize=True)
@given(data=st.data())
def test_no_damage_raises_anything_but_message_error(data: st.DataObject) -> None:
    sound = homography_cdr(track(TILTED), HEADER, SIZE)
    assert len(complaint(read_homography, data.draw(damaged(sound))).splitlines()) <= 1
