"""camera_info of camera drivers: read, or refused with a reason."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from message_makers import complaint, damaged
from rclpy.serialization import serialize_message
from sensor_msgs.msg import CameraInfo

from stab_ros.core.errors import MessageError
from stab_ros.imaging.camera import Camera
from stab_ros.io.camera_message import read_camera, read_size

SIZE = (640, 480)
K = np.array([[800.0, 0.0, 321.5], [0.0, 805.0, 238.25], [0.0, 0.0, 1.0]])
PLUMB_BOB = Camera(K, np.array([-0.2, 0.05, 1e-3, -1e-3, 0.01]), "plumb_bob", SIZE)


def camera_info(**fields: object) -> CameraInfo:
    message = CameraInfo(width=640, height=480, distortion_model="plumb_bob", d=list(PLUMB_BOB.D), k=K.ravel(),
                         r=np.eye(3).ravel(), p=np.eye(3, 4).ravel())
    for name, value in fields.items():
        target, _, leaf = name.rpartition("__")
        setattr(getattr(message, target) if target else message, leaf, value)
    return message


@pytest.mark.parametrize("fields", [{}, {"binning_x": 1, "binning_y": 1}, {"roi__width": 640, "roi__height": 480}])
def test_camera_is_read(fields: dict[str, int]) -> None:
    camera = read_camera(serialize_message(camera_info(**fields)))
    assert (camera.model, camera.size) == ("plumb_bob", SIZE)
    np.testing.assert_array_equal(camera.K, K)
    np.testing.assert_array_equal(camera.D, PLUMB_BOB.D)


@pytest.mark.parametrize("fields", [
    {"k": [0.0] * 9}, {"k": [np.nan] * 9}, {"d": [np.inf] * 5}, {"d": [0.1] * 3}, {"distortion_model": "unheard of"},
    {"roi__x_offset": 4}, {"roi__width": 320}, {"roi__width": 320, "roi__height": 240, "roi__x_offset": 321}])
def test_camera_that_cannot_be_used_is_refused(fields: dict[str, object]) -> None:
    with pytest.raises(MessageError, match="camera_info"):
        read_camera(serialize_message(camera_info(**fields)))


BINNED = {"binning_x": 2, "binning_y": 3}
CUT = {"roi__x_offset": 100, "roi__y_offset": 60, "roi__width": 401, "roi__height": 300}


@pytest.mark.parametrize(("fields", "size"), [
    (BINNED, (320, 160)), (CUT, (401, 300)), ({**CUT, **BINNED}, (200, 100)), ({**CUT, "binning_x": 1}, (401, 300))])
def test_roi_and_binning_give_the_camera_of_the_published_image(fields: dict[str, int], size: tuple[int, int]) -> None:
    """The published pixel (u, v) is the sensor's at roi + binning * (u, v): REP 104, toFullResolution."""
    camera = read_camera(serialize_message(camera_info(**fields)))
    assert camera.size == size
    rays = np.random.default_rng(1).uniform(-0.3, 0.3, (50, 2))
    offset = [fields.get("roi__x_offset", 0), fields.get("roi__y_offset", 0)]
    binning = [fields.get("binning_x", 1), fields.get("binning_y", 1)]
    np.testing.assert_allclose(camera.pixels(rays) * binning + offset, PLUMB_BOB.pixels(rays), atol=1e-9)


@pytest.mark.parametrize(("fields", "size"), [({}, SIZE), ({"width": 0}, None), ({"height": 0}, None)])
def test_size_is_read_if_it_is_set(fields: dict[str, int], size: tuple[int, int] | None) -> None:
    assert read_size(serialize_message(camera_info(**fields))) == size


@settings(max_examples=150, deadline=None, derandomize=True)
@given(data=st.data())
def test_no_damage_raises_anything_but_message_error(data: st.DataObject) -> None:
    sound = serialize_message(camera_info())
    assert len(complaint(read_camera, data.draw(damaged(sound))).splitlines()) <= 1
