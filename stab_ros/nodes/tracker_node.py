"""The live tracker: a thin shell around `Stabilizer`, the same engine and the same messages as the command's."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.qos import QoSProfile
from sensor_msgs.msg import CameraInfo, CompressedImage, Image
from std_srvs.srv import Trigger

from stab_ros.core.errors import InputError, MessageError
from stab_ros.core.kernels import Compilation, compile_kernels
from stab_ros.core.memory import give_back_memory
from stab_ros.core.settings import Value
from stab_ros.core.timeline import Advance
from stab_ros.core.types import Frame, State, Track
from stab_ros.io.messages import (
    COMPRESSED_IMAGE,
    IMAGE,
    SECOND_NS,
    Header,
    header_of,
    homography_cdr,
    image_cdr,
    read_image,
    static_map_cdr,
    track_cdr,
)
from stab_ros.io.outgoing_image import OutgoingImage
from stab_ros.nodes import params
from stab_ros.nodes.camera_feed import CameraFeed
from stab_ros.nodes.gap_counter import GapCounter
from stab_ros.nodes.outlet import Outlet
from stab_ros.nodes.qos import LATCHED, AdaptiveSubscription, keep_all_reliable, newest_only
from stab_ros.nodes.reference_file import ReferenceFile
from stab_ros.nodes.runtime import StabNode
from stab_ros.nodes.spinner import Spinner
from stab_ros.nodes.stamp_watch import StampWatch
from stab_ros.nodes.tracker_status import TrackerStatus
from stab_ros.parameters.engines import make_stabilizer, reconfigure
from stab_ros.parameters.node_settings import TrackerSettings
from stab_ros.parameters.table import PARAMETERS, check_change, table_with_preset
from stab_ros.tracking.debug_image import draw_debug
from stab_ros.tracking.reference import SMALLEST_PX
from stab_ros.tracking.stabilizer import Stabilizer
from stab_ros.tracking.start_buffer import GroundState
from stab_ros.tracking.static_map import StaticMap

_LOOK_NS = SECOND_NS // 10  # how often subscribers and publishers are looked at
_WARN_EVERY_S = 5.0
_HELD_IMAGES = 100  # until the first camera_info


SETTINGS = params.table_of(TrackerSettings)
# everything of the engine but the camera and the map, which are fixed once the first frame has been taken
CHANGEABLE = frozenset(PARAMETERS) - {"use_camera_info", "static_map"}


@dataclass(frozen=True)
class _Waiting:
    """A frame until it is answered: its header, its size (width, height) and when it was published."""

    header: Header
    size: tuple[int, int]
    source_ns: int


class TrackerNode(StabNode):
    """Answers every image with its homography to the reference, and with the image in the reference's place."""

    COMPUTES = True

    def __init__(self) -> None:
        super().__init__("tracker_node")
        table = table_with_preset(params.given(self, "method"))
        values = params.declare(self, {**table, **SETTINGS}, CHANGEABLE)
        params.warn_of_unknown(self, values)
        chosen: Any = {item.name: values.pop(item.name) for item in fields(TrackerSettings)}
        self.settings = TrackerSettings(**chosen)
        self.values = values
        self.stabilizer: Stabilizer = make_stabilizer(values)
        self.camera = CameraFeed(self, self._use_camera) if values["use_camera_info"] else None
        self.status = TrackerStatus(str(values["method"]), round(self.settings.stale_s * SECOND_NS))
        self._image_type = COMPRESSED_IMAGE if self.settings.image_transport == "compressed" else IMAGE
        self._input: AdaptiveSubscription | None = None
        self._warned_s: dict[str, float] = {}  # by kind of warning
        self._gaps, self._stamps = GapCounter(), StampWatch()
        self._file = ReferenceFile(self.settings.reference_path, self.get_logger())
        self._file.check_camera(self.camera is not None)
        self._held: deque[tuple[bytes, int]] = deque(maxlen=_HELD_IMAGES)
        self._waiting: dict[int, _Waiting] = {}  # frames that are not answered yet, by index
        self._published_reference: Frame | None = None
        self._published_map: StaticMap | None = None
        self._ground = GroundState.UNDECIDED  # when we last looked
        self._make_outlets(lossless=self.settings.queue_depth == 0)
        self.create_service(Trigger, "~/reset_reference", self._reset_reference)
        params.LiveChanges(self, PARAMETERS, self._change)
        self.every(1.0, self._report)

    def _make_outlets(self, lossless: bool) -> None:
        self.homography = Outlet(self, CameraInfo, "homography", QoSProfile(depth=100), lossless)
        self.stabilized = Outlet(self, Image, "image_stabilized", QoSProfile(depth=1), lossless)
        self.track = Outlet(self, DiagnosticArray, "~/track", QoSProfile(depth=100), lossless)
        self.reference_image = Outlet(self, Image, "~/reference_image", LATCHED)
        self.static_map = Outlet(self, Image, "~/static_map", LATCHED)
        self.debug_image = Outlet(self, Image, "~/debug_image", QoSProfile(depth=1))

    def _resume(self) -> None:
        """Goes on where an earlier run ended, if it has saved its reference."""
        saved = self._file.saved
        if saved is None:
            return
        if self.camera is not None and saved.camera_info is not None:
            self.camera.restore(saved.camera_info)
            self.stabilizer = make_stabilizer(self.values, self.camera.camera)
        self._file.resume(self.stabilizer)
        self._publish_references()

    def on_compiling(self, so_far: Compilation) -> None:
        self.status.waiting_for = f"kernels to be compiled, {so_far.done} of {so_far.total} are"

    def prepare(self) -> None:
        compile_kernels()  # done already, unless somebody else's process spins this node
        self._resume()
        self.every(_LOOK_NS / SECOND_NS, self._look)
        self._look()

    def work(self, spinner: Spinner) -> None:
        super().work(spinner)
        for outlet in (self.homography, self.track, self.stabilized):
            outlet.flush()  # the last answer may still be on its way

    def _look(self) -> None:
        """Starts to take images once enough subscribers listen, and follows the publishers' QoS."""
        self.free.ticked(_LOOK_NS)
        if self.camera is not None:
            self.camera.refresh()
        if self._input is not None:
            self._input.refresh()
            self._answer_in_silence(self._input.publishers)
        elif self.homography.subscribers >= self.settings.wait_for_subscribers:
            self._input = self._open_input()
            self.status.waiting_for = f"images on {self._input.topic}" + (" and camera_info" if self.camera else "")
            self.get_logger().info(f"ready, taking images from {self._input.topic}")
        else:
            self.status.waiting_for = f"{self.settings.wait_for_subscribers} subscribers of homography"

    def _answer_in_silence(self, publishers: int) -> None:
        """Whoever waits for the frames of a start gets them, if no more are coming to tell water and ground by."""
        silence, free_ns = self.status.silence, self.free.ns
        ended = publishers == 0 and silence.is_stale(free_ns)
        tracks = self.stabilizer.pause(ended) if ended or silence.is_lasting(free_ns) else []
        if tracks:
            self._publish_tracks(tracks)
            self._publish_references()

    def _tell_ground(self) -> None:
        """What frames of a start were answered by, where that was too little."""
        before, self._ground = self._ground, self.stabilizer.ground
        if self._ground is GroundState.PROVISIONAL and before is not self._ground:
            self._warn("provisional", "frames were answered as no more came, before enough was seen to tell what is "
                       "ground; that is decided when images return")
        if before is GroundState.PROVISIONAL and before is not self._ground:
            self._warn("decided", "what is ground was decided anew, frames before were answered by what was seen "
                       f"then; reset_counter is {self.stabilizer.reset_counter}")

    def _open_input(self) -> AdaptiveSubscription:
        compressed = self._image_type == COMPRESSED_IMAGE
        msg_class, topic = (CompressedImage, "image_raw/compressed") if compressed else (Image, "image_raw")
        choose = newest_only if self.settings.queue_depth else keep_all_reliable
        return AdaptiveSubscription(self, msg_class, topic, self._on_image, choose,
                                    "let it offer RELIABLE, or set queue_depth:=1")

    def _on_image(self, cdr: bytes, info: Mapping[str, int]) -> None:
        if self._input is not None:
            self.status.on_dropped(self._gaps.missed(info["publication_sequence_number"], self._input.publishers))
        if self.camera is None or self.camera.camera is not None:
            self._answer(cdr, info["source_timestamp"])
        else:
            self._hold(cdr, info["source_timestamp"])

    def _hold(self, cdr: bytes, source_ns: int) -> None:
        """Keeps the image until its camera is known, unless only the newest counts."""
        room = 0 if self.settings.queue_depth else _HELD_IMAGES
        self.status.on_dropped(int(len(self._held) >= room))
        if room:
            self._held.append((cdr, source_ns))

    def _answer(self, cdr: bytes, source_ns: int) -> None:
        index = self.stabilizer.frames
        try:
            frame = _read(cdr, self._image_type)
            if self._stamps.is_duplicate(frame.stamp_ns):
                self.status.on_dropped(1)
                self._warn_of(Advance.SAME)
                return
            tracks = self.stabilizer.answers(frame)
        except InputError as error:
            self.status.on_refused()
            self._warn("refused", f"refused an image: {error}")
            return
        self._count(frame)
        self._waiting[index] = _Waiting(header_of(frame), frame.size, source_ns)
        self._publish_tracks(tracks)
        self._publish_references()
        if tracks and tracks[-1].index == index:
            self._publish_images(frame, tracks[-1])

    def _count(self, frame: Frame) -> None:
        """An image that is answered: says what is odd about when it has come."""
        gap_s = self.status.on_image(self.free.ns)
        if gap_s:
            self._warn("gap", f"images again after {gap_s:.1f} s without any, at stamp {frame.stamp_ns} ns")
        self._warn_of(self._stamps.take(frame.stamp_ns))

    def _warn_of(self, step: Advance) -> None:
        text = self._stamps.words(step)
        if text:
            self._warn(step.value, text)

    def _warn(self, kind: str, text: str) -> None:
        """With the next report and, now and then of each kind, in the log."""
        self.status.remark(kind, text)
        now_s = time.monotonic()
        if now_s - self._warned_s.get(kind, -_WARN_EVERY_S) >= _WARN_EVERY_S:
            self._warned_s[kind] = now_s
            self.get_logger().warning(text)

    def _publish_tracks(self, tracks: list[Track]) -> None:
        """What others wait for comes before the slow warp; what was deferred comes under its own stamp."""
        camera = self.camera.camera if self.camera else None
        for track in tracks:
            waiting = self._waiting.pop(track.index)
            reference = self.stabilizer.reference
            size = waiting.size if reference is None or track.tracked else reference.size
            self.homography.send(homography_cdr(track, waiting.header, size, camera))
            self.track.send(track_cdr(track, waiting.header, self.stabilizer.window))
            self.status.on_track(track, time.time_ns() - waiting.source_ns)
        self._tell_ground()

    def _publish_references(self) -> None:
        """The reference and the static map, where they are new."""
        reference, static_map = self.stabilizer.reference, self.stabilizer.static_map
        if reference is not None and reference is not self._published_reference:
            self._publish_reference(reference)
        if reference is not None and static_map is not None and static_map is not self._published_map:
            self._published_map = static_map
            give_back_memory()
            self.static_map.send(static_map_cdr(static_map, header_of(reference)))
        failure = self._file.keep(self.stabilizer, self.camera.message if self.camera else None)
        if failure:
            self.status.remark("reference_path", failure)

    def _publish_images(self, frame: Frame, track: Track) -> None:
        header = header_of(frame)
        if self.stabilized.subscribers:
            message = OutgoingImage(frame.encoding, header)
            image = self.stabilizer.warp(frame, track, message.allocate)
            if image is not None:
                self.stabilized.send(message.cdr(image))
        if self.debug_image.subscribers:
            self.debug_image.send(image_cdr(draw_debug(frame, self.stabilizer), "bgr8", header))

    def _publish_reference(self, reference: Frame) -> None:
        before, self._published_reference = self._published_reference, reference
        if before is not None and not before.is_like(reference):
            self._warn("kind", f"the images are {reference.kind} now, they were {before.kind}: a new reference")
        if self.camera is not None:
            self.camera.settled = True
        in_place = Track(State.TRACKED, 0, reference.stamp_ns, reference.stamp_ns, 0, ref_H_cur=np.eye(3))
        image = self.stabilizer.warp(reference, in_place)  # without lens distortion, as `image_stabilized`
        if image is not None:
            self.reference_image.send(image_cdr(image, reference.encoding, header_of(reference)))

    def _use_camera(self) -> None:
        """A camera has become known: the engine starts with it, and takes what was held back."""
        assert self.camera is not None
        self.stabilizer = make_stabilizer(self.values, self.camera.camera)
        while self._held:
            self._answer(*self._held.popleft())

    def _reset_reference(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._publish_tracks(self.stabilizer.finish())
        self._file.forget()
        self.stabilizer.reset_reference()
        response.success, response.message = True, "the next frame becomes the reference"
        return response

    def _change(self, changed: dict[str, Value]) -> None:
        check_change(self.values, changed)
        if self._file.waits:
            raise InputError("the saved reference is not in force yet, set it again once the tracker is ready")
        values = {**self.values, **changed}
        reconfigure(self.stabilizer, values)
        self.values = values
        self.status.method = str(values["method"])

    def _report(self) -> None:
        self.status.rival, self.status.relief = self.stabilizer.competing_hypothesis, self.stabilizer.relief
        self.status.ground = self.stabilizer.ground
        self.status.stamps, self.status.before = self._stamps.counts, self._gaps.before
        report = self.status.report(self.free.ns)
        self.report(report.level, report.message, report.values)


def _read(cdr: bytes, msgtype: str) -> Frame:
    """The frame in a message. Raises MessageError also where it is too small to find anything again in it."""
    frame = read_image(cdr, msgtype)
    if min(frame.size) < SMALLEST_PX:
        raise MessageError(f"image width x height is {frame.size[0]}x{frame.size[1]}, "
                           f"both must be at least {SMALLEST_PX} px")
    return frame
