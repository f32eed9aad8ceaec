"""A camera whose tracker and sensors are played by a test, before a georeference node."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseWithCovarianceStamped
from live_graph import Graph, NodeProcess, image_message, values_of
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import CameraInfo, Image, RegionOfInterest
from truth import picture, translation

from stab_ros.core.types import FloatArray, Frame, LostReason, State, Track
from stab_ros.georeferencing.georeferencer import Georeferencer
from stab_ros.georeferencing.placement import Motion
from stab_ros.imaging.camera import Camera
from stab_ros.imaging.window import Window
from stab_ros.io.cdr import Header
from stab_ros.io.homography_message import homography_cdr
from stab_ros.io.track_message import track_cdr
from stab_ros.parameters.engines import make_georeferencer

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
SIZE = (400, 300)
STEP_NS = 40_000_000
WHOLE = Window()
K = np.array([[380.0, 0, 201], [0, 380, 148], [0, 0, 1]])
CAMERA = Camera(K, np.array([-0.1, 0.01, 0, 0, 0]), "plumb_bob", SIZE)
NODE = "/cam/georeference_node"


def camera_info(size: tuple[int, int] = SIZE) -> CameraInfo:
    return CameraInfo(width=size[0], height=size[1], distortion_model=CAMERA.model, d=list(CAMERA.D),
                      k=list(CAMERA.K.ravel()))


def binned_info() -> CameraInfo:
    """The same images, as told by a driver whose sensor has 1000x700 px: cut to 800x600 of them and binned by 2."""
    sensor_K = np.diag([2.0, 2.0, 1.0]) @ CAMERA.K
    sensor_K[:2, 2] += (60, 40)
    return CameraInfo(width=1000, height=700, distortion_model=CAMERA.model, d=list(CAMERA.D), k=list(sensor_K.ravel()),
                      binning_x=2, binning_y=2, roi=RegionOfInterest(x_offset=60, y_offset=40, width=800, height=600))


def shot(number: int) -> Frame:
    """Each picture shows another part of the ground."""
    return Frame(picture(translation(-0.7 * number, 0.4 * number), SIZE, noise=1.0), "mono8",
                 10**9 + number * STEP_NS, "cam")


def motion(number: int) -> Motion:
    """Not only a shift, so that each of its numbers counts."""
    H = np.array([[1 + 1e-3 * number, 2e-4, 0.7 * number], [-1e-4, 1 - 5e-4 * number, -0.4 * number], [1e-7, 0, 1]])
    return Motion(H, np.diag(np.arange(1.0, 9.0)) * 1e-8, 0)


class GeoreferencedStream:
    """The node, what it says, and what it hears."""

    def __init__(self, graph: Graph, settings: Mapping[str, Any], image: bool = True, info: bool = True) -> None:
        self.graph = graph
        self.infos: list[Any] = graph.listen(CameraInfo, "/cam/ortho_info")
        self.status: list[Any] = graph.listen(DiagnosticArray, f"{NODE}/status")
        self.poses: list[Any] = graph.listen(PoseWithCovarianceStamped, f"{NODE}/pose")
        self.reports: list[Any] = graph.listen(DiagnosticArray, "/diagnostics")
        self.images: list[Any] = graph.listen(Image, "/cam/image_ortho") if image else []
        self.node: NodeProcess = graph.start("georeference_node", "/cam", queue_depth=0,
                                             **{"wait_for_subscribers": 1, **settings})
        if info:
            self.info = graph.node.create_publisher(CameraInfo, "/cam/camera_info", LATCHED)
            self.info.publish(camera_info())
        self._images = graph.speak(Image, f"/cam/{settings.get('input', 'image_raw')}")
        self._homographies: Any = None
        self._tracks: Any = None
        self._tracked: Camera | None = None

    def show(self, frame: Frame) -> None:
        message = image_message(frame.image, frame.stamp_ns)
        self._images.publish(message)

    def publish(self, message: Any) -> None:
        """An image, whatever it is."""
        self._images.publish(message)

    def start_tracker(self, track: bool = True, camera: Camera | None = CAMERA) -> None:
        """It can tell of frames from now on. track: it publishes its tracks, too. camera: whose lens it removes."""
        self._tracked = camera
        self._homographies = self.graph.speak(CameraInfo, "/cam/homography")
        self._tracks = self.graph.speak(DiagnosticArray, "/cam/tracker_node/track") if track else None

    def tell(self, stamp_ns: int, told: Motion | None, window: Window = WHOLE) -> None:
        """The homography of a frame, and its track. window: that image_stabilized shows."""
        if self._homographies is None:
            self.start_tracker()
        values = Track(State.LOST, 0, stamp_ns, 0, 0, lost_reason=LostReason.NO_TEXTURE) if told is None else Track(
            State.TRACKED, 0, stamp_ns, 0, told.reset_counter, ref_H_cur=told.ref_H_cur, covariance=told.covariance)
        header = Header(stamp_ns, "cam")
        self._homographies.publish(homography_cdr(values, header, SIZE, self._tracked))
        if self._tracks is not None:
            self._tracks.publish(track_cdr(values, header, window))

    def until_answered(self, count: int) -> list[dict[str, str]]:
        """The status of each frame."""
        self.graph.until(lambda: min(len(self.status), len(self.infos)) >= count, f"{count} answers")
        return [values_of(one) for one in self.status]

    def until_said(self, words: str) -> None:
        self.graph.until(lambda: any(words in one.status[0].message for one in self.reports), f"{words!r} being said")

    def until_reported(self, **wanted: object) -> dict[str, str]:
        def is_so() -> bool:
            return bool(self.reports) and all(
                values_of(self.reports[-1]).get(name) == str(value) for name, value in wanted.items())

        self.graph.until(is_so, f"a report of {wanted}")
        return values_of(self.reports[-1])


def by_the_engine(settings: Mapping[str, Any], stabilized: bool = False) -> Georeferencer:
    return make_georeferencer(settings, CAMERA, SIZE, np.eye(3) if stabilized else None)


def ortho_H_image(message: Any) -> FloatArray:
    """As README says how a downstream node reads it."""
    K, R, P = np.reshape(message.k, (3, 3)), np.reshape(message.r, (3, 3)), np.reshape(message.p, (3, 4))
    H = P[:, :3] @ R @ np.linalg.inv(K)
    return np.asarray(H / H[2, 2])
