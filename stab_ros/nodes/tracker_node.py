"""The live tracker: the ROS side of `Stabilizer`, with the same engine and messages as the command `stabilize`."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any

from stab_ros.core.errors import InputError, MessageError
from stab_ros.core.kernels import Compilation
from stab_ros.core.settings import Value
from stab_ros.core.text import counted
from stab_ros.core.timeline import Advance
from stab_ros.core.types import Frame, LostReason, ResetReason, State, Track
from stab_ros.io.advice import FixedToCamera, why_anew
from stab_ros.io.cdr import SECOND_NS, Header, header_of
from stab_ros.io.topics import HOMOGRAPHY_TOPIC
from stab_ros.nodes import params
from stab_ros.nodes.camera_info_subscription import CameraInfoSubscription
from stab_ros.nodes.failures import Failures
from stab_ros.nodes.image_input import ImageInput
from stab_ros.nodes.lost_log import LostLog
from stab_ros.nodes.managed_node import StabNode
from stab_ros.nodes.received_image import ReceivedImage
from stab_ros.nodes.reference_file import ReferenceFile
from stab_ros.nodes.reference_services import ReferenceServices
from stab_ros.nodes.sleep import Sleep
from stab_ros.nodes.stabilized_camera import StabilizedCamera
from stab_ros.nodes.stabilized_pictures import StabilizedPictures
from stab_ros.nodes.stamp_monitor import StampMonitor
from stab_ros.nodes.throttled_warnings import ThrottledWarnings
from stab_ros.nodes.tracker_publishers import TrackerPublishers
from stab_ros.nodes.tracker_status import TrackerStatus
from stab_ros.parameters.engines import make_stabilizer, reconfigure
from stab_ros.parameters.node_settings import COMPRESSED_PREFIX, CompressedSettings, TrackerSettings
from stab_ros.parameters.table import PARAMETERS, check_change, parameters_of, table_with_preset
from stab_ros.tracking.reference import SMALLEST_PX
from stab_ros.tracking.stabilizer import Stabilizer
from stab_ros.tracking.start_buffer import GroundState
from stab_ros.tracking.static_map import StaticMap

if TYPE_CHECKING:
    from typing_extensions import Unpack

    from stab_ros.nodes.node_options import NodeOptions

SETTINGS = params.table_of(TrackerSettings)
COMPRESSED = {parameter.name: parameter for parameter in parameters_of(CompressedSettings, COMPRESSED_PREFIX)}
# everything of the engine but the camera and the map, which are fixed once the first frame has been taken
CHANGEABLE = frozenset(PARAMETERS) - {"use_camera_info", "static_map"}


@dataclass(frozen=True)
class _Pending:
    """A frame that has no result yet: its header, size (width, height), kind, and when its image was published."""

    header: Header
    size: tuple[int, int]
    kind: str
    source_ns: int


class TrackerNode(StabNode):
    """Publishes for every image its homography to the reference, and the image warped to the reference."""

    COMPUTES = TAKES_IMAGES = True

    def __init__(self, **options: Unpack[NodeOptions]) -> None:
        super().__init__("tracker_node", **options)

    # lifecycle -------------------------------------------------------------------------------------------------------
    def configure(self) -> None:
        table = table_with_preset(params.given(self, "method"))
        values = params.declare(self, {**table, **SETTINGS, **COMPRESSED}, {*CHANGEABLE, *COMPRESSED})
        params.warn_of_unknown(self, values)
        chosen: Any = {item.name: values.pop(item.name) for item in fields(TrackerSettings)}
        self.settings = TrackerSettings(**chosen)
        self._compressed = {name: values.pop(name) for name in COMPRESSED}
        self.values = values
        self.stabilizer: Stabilizer = make_stabilizer(values)
        self.camera = CameraInfoSubscription(self, self._use_camera) if values["use_camera_info"] else None
        self.status = TrackerStatus(str(values["method"]), round(self.settings.stale_s * SECOND_NS))
        self._input = ImageInput(
            self, compressed=self.settings.image_transport == "compressed", keep_all=self.settings.queue_depth == 0,
            may_pass=self._knows_camera, take=self._track, dropped=self.status.on_dropped)
        self._warnings = ThrottledWarnings(self.get_logger())
        self._lost_log, self._fixed = LostLog(self.get_logger(), self._warnings), FixedToCamera()
        self._stamps, self._failures = StampMonitor(), Failures(self.get_logger())
        self._sleep = Sleep(self.settings.idle == "sleep")
        self._file = ReferenceFile(self.settings.reference_path, self.get_logger())
        self._file.check_camera(self.camera is not None)
        self._pending: dict[int, _Pending] = {}  # by index of the frame
        self._published_reference: Frame | None = None
        self._published_map: StaticMap | None = None
        self._resets = 0  # as far as they were said
        self._ground = GroundState.UNDECIDED  # at the last check
        lossless = self.settings.queue_depth == 0
        self.outputs = TrackerPublishers(self, lossless, StabilizedPictures(
            self, StabilizedCamera(self, self.camera), _compressed_settings(self._compressed),
            self.settings.reference_frame, self._failures, lossless))
        self._on_reference = ReferenceServices(self, self._file)
        self.at_cleanup(self.outputs.pictures.close)
        self.at_cleanup(params.ParameterUpdates(self, {**PARAMETERS, **COMPRESSED}, self._change).close)

    def on_compilation(self, progress: Compilation) -> None:
        self.status.waiting_for = progress.awaited

    def activate(self) -> None:
        self._reset_if_asked()
        self._resume()

    def deactivate(self) -> None:
        """Answers the frames of the start that wait; the reference stays."""
        self._stop_taking()
        self._publish_tracks(self._answered(self.stabilizer.finish))
        self._publish_references()

    def _resume(self) -> None:
        """Resumes from the reference that an earlier run saved, if there is one."""
        saved = self._file.saved
        if saved is None:
            return
        if self.camera is not None and saved.camera_info is not None:
            self.camera.restore(saved.camera_info)
            self.stabilizer = make_stabilizer(self.values, self.camera.camera)
        self._file.resume(self.stabilizer)
        self._resets = self.stabilizer.reset_counter
        self._publish_references()

    def flush(self) -> None:
        self.outputs.flush()

    def destroy_node(self) -> None:
        """Also ends the thread of the pictures, where nobody has cleaned up, as after an error."""
        if self.is_configured:
            self.outputs.pictures.close()
        super().destroy_node()

    # input -----------------------------------------------------------------------------------------------------------
    def poll(self) -> None:
        """Starts to take images once enough subscribers are there, and follows the publishers' QoS."""
        self._reset_if_asked()
        self.outputs.pictures.refresh()
        if self.camera is not None:
            self.camera.refresh(self._input.held_up)
        self._sleep.look(self.outputs.subscribers, busy=self.stabilizer.buffering)
        self.status.asleep = self._sleep.is_asleep
        if self._sleep.is_asleep:
            self._fall_asleep()
        elif self._input.is_open:
            self._input.refresh()
            self.status.waiting_for = self._awaited()
            self._end_buffering_in_pause(self._input.publishers)
        elif self.outputs.homography.subscribers >= self.settings.wait_for_subscribers:
            self._input.open()
            self.status.waiting_for = self._awaited()
        else:
            subscribers = counted(self.settings.wait_for_subscribers, "subscriber")
            self.status.waiting_for = f"{subscribers} of {HOMOGRAPHY_TOPIC}"

    def _awaited(self) -> str:
        """What the first frame waits for, for people."""
        camera = "" if self.camera is None else self.camera.awaited
        return camera if self._input.held_up else " and ".join(filter(None, [self._input.awaited, camera]))

    def _fall_asleep(self) -> None:
        """Takes no more images; the engine keeps its reference."""
        if self._input.is_open:
            self._stop_taking()
            self.get_logger().info("asleep: nobody listens to any output")
        if self.images is not None and self._sleep.is_settled:
            self.images.expect_no_more(self.get_fully_qualified_name())

    def _stop_taking(self) -> None:
        """The silence until the next image is no fault of the stream."""
        self._input.close()
        self.status.timeout.suspend()
        self._stamps.suspend()

    def _knows_camera(self) -> bool:
        """Whether images can be tracked: no camera is needed, or it is known."""
        return self.camera is None or self.camera.camera is not None

    def _use_camera(self) -> None:
        """The camera has become known: starts the engine with it, and tracks the images that were held."""
        assert self.camera is not None
        self.stabilizer = make_stabilizer(self.values, self.camera.camera)
        self._input.release()

    # tracking --------------------------------------------------------------------------------------------------------
    def _track(self, image: ReceivedImage) -> None:
        self._reset_if_asked()
        index, source_ns = self.stabilizer.frames, image.source_ns
        try:
            frame = _read(image)
            if self._stamps.is_duplicate(frame.stamp_ns):
                self.status.on_dropped(1)
                self._warn_of_stamp(Advance.SAME)
                return
            self._pending[index] = _Pending(header_of(frame), frame.size, frame.kind, source_ns)
            tracks = self._answered(lambda: self.stabilizer.answers(frame))
        except InputError as error:
            self._pending.pop(index, None)
            self.status.on_refused()
            self._warn("refused", f"refused an image: {error}")
            return
        self._count(frame, source_ns)
        tracks += self._of_start(index, tracks)
        self._publish_tracks(tracks)
        self._publish_references()
        if tracks and tracks[-1].index == index:
            self.outputs.send_images(frame, tracks[-1], self.stabilizer)

    def _of_start(self, index: int, tracks: list[Track]) -> list[Track]:
        """The answer to a frame that the engine has buffered, where that shall not be late."""
        if self.settings.answer_start == "late" or any(track.index == index for track in tracks):
            return []
        if self.settings.answer_start == "at_once":
            return [_in_start(index, self._pending[index].header.stamp_ns, self.stabilizer)]
        del self._pending[index]
        self.status.on_dropped(1)
        return []

    def _answered(self, answer: Callable[[], list[Track]]) -> list[Track]:
        """What the engine answers; where it fails, all frames that wait for an answer are LOST."""
        with self._failures:
            return answer()
        self.status.on_failure(self._failures.count, self._failures.last)
        return [self.stabilizer.fail(index, one.header.stamp_ns) for index, one in self._pending.items()]

    def on_failure(self, error: BaseException) -> None:
        if not isinstance(error, Exception):
            raise error
        self._failures.note(error)
        self.status.on_failure(self._failures.count, self._failures.last)

    def _count(self, frame: Frame, source_ns: int) -> None:
        """A tracked image: warns of gaps before it and of irregular stamps."""
        gap_s = self.status.on_image(self.free.ns)
        if gap_s:
            self._warn("gap", f"images again after {gap_s:.1f} s without any, at stamp {frame.stamp_ns} ns")
        self._warn_of_stamp(self._stamps.take(frame.stamp_ns))
        fault = self._stamps.rate_fault(frame.stamp_ns, source_ns)
        if fault:
            self._warn("stamp_rate", fault)

    def _end_buffering_in_pause(self, publishers: int) -> None:
        """Publishes results for the frames in the start-up buffer if no more images come to fill it."""
        timeout, free_ns = self.status.timeout, self.free.ns
        ended = publishers == 0 and timeout.is_stale(free_ns)
        over = ended or timeout.is_pause(free_ns)
        tracks = self._answered(lambda: self.stabilizer.pause(ended)) if over else []
        if tracks:
            self._publish_tracks(tracks)
            self._publish_references()

    # output ----------------------------------------------------------------------------------------------------------
    def _publish_tracks(self, tracks: list[Track]) -> None:
        """Buffered frames are published under their own stamps; the slow warp comes after all homographies.

        Those of a start that were answered at once, or dropped, stay so.
        """
        camera = self.camera.camera if self.camera else None
        for track in [one for one in tracks if one.index in self._pending]:
            pending = self._pending.pop(track.index)
            reference = self.stabilizer.reference
            size = pending.size if reference is None or track.tracked else reference.size
            self.outputs.send_track(track, pending.header, size, camera, self.stabilizer)
            self.status.on_track(track, time.time_ns() - pending.source_ns)
            self._lost_log.on_track(track)
            self._tell_of_reset(track, pending.kind)
        self._warn_of_ground()
        self._tell_of_fixed()

    def _publish_references(self) -> None:
        """The reference and the static map, if they are new."""
        reference, static_map = self.stabilizer.reference, self.stabilizer.static_map
        if reference is not None and reference is not self._published_reference:
            self._publish_reference(reference)
        if reference is not None and static_map is not None and static_map is not self._published_map:
            self._published_map = static_map
            self.outputs.send_static_map(static_map, reference)
        failure = self._file.update(self.stabilizer, self.camera.message if self.camera else None)
        if failure:
            self.status.warn("reference_path", failure)

    def _publish_reference(self, reference: Frame) -> None:
        self._published_reference = reference
        if self.camera is not None:
            self.camera.locked = True
        self.outputs.send_reference(reference, self.stabilizer)

    # warnings and diagnostics ----------------------------------------------------------------------------------------
    def _warn_of_ground(self) -> None:
        """Frames of a start were tracked before the ground was chosen, or it has been chosen since."""
        before, self._ground = self._ground, self.stabilizer.ground
        if self._ground is before:
            return
        if self._ground is GroundState.PROVISIONAL:
            self._warn("provisional", "the images paused during start-up: the buffered frames got provisional "
                       "homographies; the ground is chosen when images return")
        if before is GroundState.PROVISIONAL:
            self._warn("decided", "the ground was chosen anew, earlier homographies were provisional; reset_counter is "
                       f"{self.stabilizer.reset_counter}")

    def _tell_of_reset(self, track: Track, kind: str) -> None:
        """Homographies begin anew with this frame. kind: of its image."""
        if not track.tracked or track.reset_counter == self._resets:
            return
        self._resets = track.reset_counter
        text = (f"homographies begin anew at stamp {track.stamp_ns} ns: {why_anew(track.reset_reason, kind)}; "
                f"reset_counter is {track.reset_counter}")
        if track.reset_reason is ResetReason.ASKED:
            self.get_logger().info(text)
        else:
            self._warn("reset", text)

    def _tell_of_fixed(self) -> None:
        news = self._fixed.news(self.stabilizer.reference, self.stabilizer.sensor_fixed_share)
        if news:
            self.get_logger().info(news)

    def _warn_of_stamp(self, step: Advance) -> None:
        text = self._stamps.words(step)
        if text:
            self._warn(step.value, text)

    def _warn(self, kind: str, text: str) -> None:
        """In the next report, and throttled in the log."""
        self.status.warn(kind, text)
        self._warnings.log(kind, text)

    def report(self) -> None:
        if self._failures.count > self.status.errors:  # of the thread that compresses pictures
            self.status.on_failure(self._failures.count, self._failures.last)
        self.status.competing, self.status.relief = self.stabilizer.competing_hypothesis, self.stabilizer.relief
        self.status.ground, self.status.swing = self.stabilizer.ground, self.stabilizer.swing
        self.status.copied = self.stabilizer.copied_share
        self.status.stamps, self.status.before = self._stamps.counts, self._input.before
        self.publish_diagnostics(self.status.report(self.free.ns))

    # services and parameters -----------------------------------------------------------------------------------------
    def _reset_if_asked(self) -> None:
        """The answer was given already."""
        if self._on_reference.reset_is_asked:
            self._publish_tracks(self._answered(self.stabilizer.finish))
            self.stabilizer.reset_reference()
            self._on_reference.reset_is_made()

    def _change(self, changed: dict[str, Value]) -> None:
        compressed = {**self._compressed, **{name: changed[name] for name in COMPRESSED if name in changed}}
        of_pictures = _compressed_settings(compressed)
        self._change_engine({name: value for name, value in changed.items() if name in PARAMETERS})
        self._compressed, self.outputs.pictures.compressed.settings = compressed, of_pictures

    def _change_engine(self, changed: dict[str, Value]) -> None:
        if not changed:
            return
        self._reset_if_asked()
        check_change(self.values, changed)
        values = {**self.values, **changed}
        if not self._file.is_pending:
            reconfigure(self.stabilizer, values)
        elif self.is_paused:  # as after an activation that failed: the next one judges whether they fit the reference
            self.stabilizer = make_stabilizer(values, None if self.camera is None else self.camera.camera)
        else:
            raise InputError("the saved reference is not in force yet, set it again once the tracker is ready")
        self.values = values
        self.status.method = str(values["method"])


def _in_start(index: int, stamp_ns: int, stabilizer: Stabilizer) -> Track:
    """The answer to a frame of a start before that is over."""
    reference = stabilizer.reference
    return Track(State.LOST, index, stamp_ns, 0 if reference is None else reference.stamp_ns, stabilizer.reset_counter,
                 lost_reason=LostReason.STARTING, reset_reason=stabilizer.reset_reason)


def _compressed_settings(values: Mapping[str, Value]) -> CompressedSettings:
    """values: by the names of COMPRESSED. Raises ConfigError for one out of range."""
    chosen: Any = {name.removeprefix(COMPRESSED_PREFIX): value for name, value in values.items()}
    return CompressedSettings(**chosen)


def _read(image: ReceivedImage) -> Frame:
    """The frame in a message. Raises MessageError also if it is too small to track anything in it."""
    frame = image.frame()
    if min(frame.size) < SMALLEST_PX:
        raise MessageError(f"image width x height is {frame.size[0]}x{frame.size[1]}, "
                           f"both must be at least {SMALLEST_PX} px")
    return frame
