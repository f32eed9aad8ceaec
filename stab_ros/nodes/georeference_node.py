"""Georeferencing live: the ROS side of `Georeferencer`, with the engine and the messages of `stab-ros georeference`."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Any, TypeAlias

import numpy as np

from stab_ros.core.errors import InputError, MessageError
from stab_ros.core.kernels import Compilation, compile_kernels
from stab_ros.core.settings import Value
from stab_ros.core.timeline import Advance
from stab_ros.core.types import Frame, Homography
from stab_ros.georeferencing.georeferencer import Georeferenced, Georeferencer
from stab_ros.georeferencing.local_frame import LocalFrame
from stab_ros.georeferencing.orientation import Unplaced
from stab_ros.georeferencing.samples import AttitudeSample
from stab_ros.georeferencing.settings import needs_motion, needs_sensors
from stab_ros.imaging.camera import Camera
from stab_ros.io.attitude_message import Attitude
from stab_ros.io.cdr import SECOND_NS
from stab_ros.io.fix_message import Fix
from stab_ros.io.georeference_messages import gcps_of_cdr, georeference_values, origin_cdr
from stab_ros.io.image_message import read_image
from stab_ros.io.topics import FIX_TOPIC, ORTHO_INFO_TOPIC, STABILIZED_TOPIC, WATER_LEVEL_TOPIC
from stab_ros.io.water_level_message import WaterLevel
from stab_ros.nodes import params
from stab_ros.nodes.camera_info_subscription import CameraInfoSubscription
from stab_ros.nodes.failures import Failures
from stab_ros.nodes.georeference_publishers import GeoreferencePublishers
from stab_ros.nodes.georeference_status import GeoreferenceStatus, Result
from stab_ros.nodes.image_input import ImageInput
from stab_ros.nodes.motion_input import MotionInput, Told
from stab_ros.nodes.patience import Patience
from stab_ros.nodes.runtime import StabNode
from stab_ros.nodes.sensor_inputs import SensorInputs
from stab_ros.nodes.spinner import Spinner
from stab_ros.nodes.stamp_monitor import StampMonitor
from stab_ros.nodes.stamp_pairing import Pair, StampPairing
from stab_ros.nodes.throttled_warnings import ThrottledWarnings
from stab_ros.parameters.engines import camera_of, check_georeference, make_georeferencer
from stab_ros.parameters.node_settings import GeoreferenceSettings
from stab_ros.parameters.table import GEOREFERENCE_PARAMETERS, georeference_config

_POLL_NS = SECOND_NS // 10  # period at which subscribers, publishers and the silence are checked
_SENSORS = (FIX_TOPIC, "attitude")  # which frames wait for in the engine
_SAMPLES = 20_000  # of sensors that are kept for another engine

SETTINGS = params.table_of(GeoreferenceSettings)
CHANGEABLE = frozenset(GEOREFERENCE_PARAMETERS) - {"camera_file", "crs", "origin"}  # the map stays as it is


@dataclass(frozen=True, eq=False)
class _Taken:
    """A frame that has no answer yet, and when its image was published."""

    frame: Frame
    source_ns: int


_Paired: TypeAlias = "Pair[_Taken, Told]"


class GeoreferenceNode(StabNode):
    """Publishes for every image where it lies on the water plane, and its orthophoto."""

    COMPUTES = True

    def __init__(self) -> None:
        super().__init__("georeference_node")
        values = params.declare(self, {**GEOREFERENCE_PARAMETERS, **SETTINGS}, CHANGEABLE)
        params.warn_of_unknown(self, values)
        chosen: Any = {item.name: values.pop(item.name) for item in fields(GeoreferenceSettings)}
        self.settings = GeoreferenceSettings(**chosen)
        check_georeference(values)
        self.values, self._config = values, georeference_config(values)
        self._stabilized = self.settings.input == STABILIZED_TOPIC
        self.engine: Georeferencer | None = None
        self._camera_of_file: Camera | None = None  # for images of their size
        self._unmade = ""  # why there is no engine
        self._origin: LocalFrame | None = None  # of the map; it stays
        self._rejected: tuple[str, ...] | None = None  # control points, as the last message of them shows
        self._camera_info = CameraInfoSubscription(self, self._use_camera) if self._takes_camera_info else None
        self.status = GeoreferenceStatus(self._config.orientation, round(self.settings.stale_s * SECOND_NS))
        self._images = ImageInput(
            self, compressed=self.settings.image_transport == "compressed", keep_all=self.settings.queue_depth == 0,
            may_pass=self._knows_camera, take=self._on_image, dropped=self._on_dropped, topic=self.settings.input)
        self._motions: MotionInput | None = None
        self._sensors = SensorInputs(self, self.settings, self, lambda: self._newest_ns)
        self._frames: StampPairing[_Taken, Told] = StampPairing(
            self.settings.backlog_mb * 1e6, lambda taken: taken.frame.image.nbytes)
        self._pending: deque[_Taken] = deque()  # in the engine
        self._samples: deque[Fix | Attitude | WaterLevel] = deque(maxlen=_SAMPLES)
        self._newest_ns, self._size = -1, (0, 0)  # stamp and size of the newest frame
        self._window_H_ref: Homography = np.eye(3)  # of image_stabilized
        self._resets = 0  # as far as they were said
        self._patience: dict[str, Patience] = {}  # with the topics that frames wait for
        self._warnings = ThrottledWarnings(self.get_logger())
        self._stamps, self._failures = StampMonitor(), Failures(self.get_logger())
        self.outputs = GeoreferencePublishers(self, lossless=self.settings.queue_depth == 0)
        params.ParameterUpdates(self, GEOREFERENCE_PARAMETERS, self._change)
        self.create_steady_timer(1.0, self._report)

    # start and end ---------------------------------------------------------------------------------------------------
    def on_compilation(self, progress: Compilation) -> None:
        self.status.waiting_for = f"kernels to be compiled, {progress.done} of {progress.total} are done"

    def prepare(self) -> None:
        compile_kernels()  # done already, unless another executor spins this node
        self._open_inputs()
        self.create_steady_timer(_POLL_NS / SECOND_NS, self._poll)
        self._poll()

    def work(self, spinner: Spinner) -> None:
        super().work(spinner)
        self.outputs.flush()

    def on_failure(self, error: BaseException) -> None:
        if not isinstance(error, Exception):
            raise error
        self._failures.note(error)
        self._say_failure()

    def _say_failure(self) -> None:
        self.status.errors = self._failures.count
        self.status.warn("internal", self._failures.last)

    # what is taken ---------------------------------------------------------------------------------------------------
    @property
    def _takes_camera_info(self) -> bool:
        return self.settings.use_camera_info and not self.values["camera_file"] and not self._stabilized

    @property
    def _takes_motion(self) -> bool:
        return self._stabilized or self.settings.use_homographies or needs_motion(self._config)

    def _knows_camera(self) -> bool:
        """Whether images can be placed: no camera_info is needed, or it is known."""
        return self._camera_info is None or self._camera_info.camera is not None

    def _use_camera(self) -> None:
        """The camera has become known, or is another one as long as no frame was placed."""
        self._unmade = ""
        self._images.release()

    def _poll(self) -> None:
        """Follows the publishers, starts to take images once subscribers are there, gives up waiting for the silent."""
        self.free.ticked(_POLL_NS)
        self._sensors.refresh()
        self.status.faults = self._sensors.faults
        if self._camera_info is not None:
            self._camera_info.refresh()
        if self._motions is not None:
            self._motions.refresh()
        if self._images.is_open:
            self._images.refresh()
            self._give_up_waiting()
        elif self.outputs.info.subscribers >= self.settings.wait_for_subscribers:
            self._open()
        else:
            self.status.waiting_for = f"{self.settings.wait_for_subscribers} subscribers of {ORTHO_INFO_TOPIC}"

    def _open(self) -> None:
        topic = self._images.open()
        self._open_inputs()
        self.status.waiting_for = f"images on {topic}" + (" and camera_info" if self._camera_info else "")
        self.get_logger().info(f"ready, taking images from {topic}")

    def _open_inputs(self) -> None:
        """Subscribes to what the orientation takes, once: it may be changed, and changed back."""
        if needs_sensors(self._config):
            self._sensors.open_attitude()
        if self._takes_motion and self._motions is None and self._images.is_open:
            self._motions = MotionInput(self, self._on_told, lambda text: self.on_unusable("", text))
            self._await(self._motions.topic)

    # input -----------------------------------------------------------------------------------------------------------
    def _on_dropped(self, images: int) -> None:
        self.status.count("frames_dropped", images)

    def _on_image(self, cdr: bytes, source_ns: int) -> None:
        try:
            frame = read_image(cdr, self._images.msgtype)
        except MessageError as error:
            self.status.count("frames_refused")
            self._warn("refused", f"refused an image: {error}")
            return
        if self._stamps.is_duplicate(frame.stamp_ns):
            self._on_dropped(1)
            return
        self._take_stamp(frame.stamp_ns)
        self.status.on_image(self.free.ns)
        self._newest_ns, self._size = frame.stamp_ns, frame.size
        taken = _Taken(frame, source_ns)
        if self._takes_motion:
            self._place(self._frames.ask(frame.stamp_ns, taken))
        else:
            self._place([Pair(frame.stamp_ns, taken, None)])

    def _take_stamp(self, stamp_ns: int) -> None:
        """Where stamps go back, samples with later ones are of another time: none of them tells of what comes now."""
        step = self._stamps.take(stamp_ns)
        text = self._stamps.words(step)
        if text:
            self._warn(step.value, text)
        if step is Advance.BACK:
            self.status.restart()
            past = [sample for sample in self._samples if sample.stamp_ns <= stamp_ns + SECOND_NS]
            self._samples = deque(past, maxlen=_SAMPLES)
            self._begin_anew()

    def _begin_anew(self) -> None:
        """Frames that wait are placed by what is known; the next one has another engine."""
        if self.engine is not None and needs_sensors(self._config):
            self._answer(self.engine.finish)
            self.engine = None

    def _on_told(self, told: Told) -> None:
        if self._motions is not None:
            self._heard(self._motions.topic)
        self._place(self._frames.answer(told.stamp_ns, told))

    def on_fix(self, fix: Fix) -> None:
        """See `SensorCallbacks`."""
        self._on_sample(FIX_TOPIC, fix)

    def on_attitude(self, attitude: Attitude) -> None:
        """See `SensorCallbacks`."""
        self._on_sample("attitude", attitude)

    def on_water_level(self, level: WaterLevel) -> None:
        """See `SensorCallbacks`."""
        self._on_sample(WATER_LEVEL_TOPIC, level)

    def on_unusable(self, topic: str, text: str) -> None:
        """See `SensorCallbacks`."""
        self.status.count("messages_refused")
        self._warn(f"unusable {topic}", f"refused a message: {topic}{topic and ': '}{text}")

    def on_doubt(self, topic: str, text: str) -> None:
        """See `SensorCallbacks`."""
        self._warn(f"doubt {topic}", f"{topic}: {text}")

    def _on_sample(self, topic: str, sample: Fix | Attitude | WaterLevel) -> None:
        offset_ns = 0 if isinstance(sample, WaterLevel) else round(self._config.time_offset_s * SECOND_NS)
        self.status.on_sample(topic, sample.stamp_ns + offset_ns)
        self._heard(topic)
        self._samples.append(sample)
        if self.engine is not None:
            self._feed(self.engine, sample)
            self._answer(self.engine.answers)

    def _feed(self, engine: Georeferencer, sample: Fix | Attitude | WaterLevel) -> None:
        """Tells the engine of a sample."""
        if isinstance(sample, WaterLevel):
            engine.set_water_level(sample.stamp_ns, sample.wse_m)
        elif isinstance(sample, Attitude):
            engine.add_attitude(AttitudeSample(sample.stamp_ns, sample.map_q_body, sample.covariance_rad2))
        elif math.isfinite(sample.height_m):
            self._feed_fix(engine, sample)

    def _feed_fix(self, engine: Georeferencer, fix: Fix) -> None:
        try:
            engine.add_fix(fix.stamp_ns, np.array([fix.latitude_deg, fix.longitude_deg, fix.height_m]),
                           fix.covariance_m2)
        except InputError as error:
            self.on_unusable(self.resolve_topic_name(FIX_TOPIC), str(error))

    # silence ---------------------------------------------------------------------------------------------------------
    def _await(self, topic: str) -> None:
        """Frames wait for messages of this topic from now on."""
        self._patience[topic] = Patience(round(self.settings.wait_s * SECOND_NS))

    def _heard(self, topic: str) -> None:
        if topic in self._patience:
            self._patience[topic].heard(self.free.ns)

    def _give_up_waiting(self) -> None:
        """Places the frames that wait for what has fallen silent, by what is there."""
        motions, silent = self._motions, self._silent()
        if motions is not None and motions.topic in silent and len(self._frames):
            motions.flush()
            self._place(self._frames.flush())
        if self.engine is not None and any(topic in silent for topic in _SENSORS):
            self._answer(self.engine.finish)
        self.status.silent = silent
        self.status.waiting = len(self._frames) + len(self._pending)

    def _silent(self) -> tuple[str, ...]:
        """The topics that frames wait for in vain."""
        return tuple(topic for topic, patience in self._patience.items()
                     if patience.check(self.free.ns, self._is_awaited(topic)))

    def _is_awaited(self, topic: str) -> bool:
        """Whether a frame waits for a message of this topic."""
        if topic not in _SENSORS:
            return len(self._frames) > 0
        return bool(self._pending) and self.status.newest_ns(topic) < self._pending[0].frame.stamp_ns

    # placing ---------------------------------------------------------------------------------------------------------
    def _place(self, pairs: list[_Paired]) -> None:
        for pair in pairs:
            told = pair.answer
            try:
                engine = self._engine_for(pair.question.frame, told)
                engine.add_frame(pair.question.frame, None if told is None else told.motion)
            except InputError as error:
                self.status.count("frames_refused")
                self._warn("refused", f"refused an image: {error}")
                continue
            self._pending.append(pair.question)
            self._answer(engine.answers)
            if told is not None:
                self._tell_of_reset(told)

    def _engine_for(self, frame: Frame, told: Told | None) -> Georeferencer:
        """The engine; it is made for the first frame, and anew where image_stabilized shows another window."""
        window_H_ref = self._window_H_ref if told is None else told.window_H_ref
        moved = self._stabilized and not np.array_equal(window_H_ref, self._window_H_ref)
        if self.engine is None or moved:
            self._window_H_ref = window_H_ref
            self._use(self._made_once(frame.size))
        assert self.engine is not None
        return self.engine

    @property
    def camera(self) -> Camera | None:
        """That took the images; None: of unknown calibration."""
        if self._stabilized:
            return None if self._motions is None else self._motions.camera
        if self._camera_of_file is not None:
            return self._camera_of_file
        return None if self._camera_info is None else self._camera_info.camera

    def _made_once(self, size: tuple[int, int]) -> Georeferencer:
        """Raises InputError, without trying again, until parameters or the camera change."""
        if self._unmade:
            raise InputError(self._unmade)
        try:
            return self._made(self.values, size)
        except InputError as error:
            self._unmade = str(error)
            self.get_logger().error(f"no frame can be placed: {error}")
            raise

    def _made(self, values: dict[str, Value], size: tuple[int, int]) -> Georeferencer:
        if self._origin is not None:
            place = (self._origin.latitude_deg, self._origin.longitude_deg, self._origin.height_m)
            values = {**values, "origin": ", ".join(map(repr, place))}
        file, _ = camera_of(values, size) if not self._stabilized else (None, ())
        self._camera_of_file = None if file is None else file.camera
        reference_size = None if self._motions is None else self._motions.reference_size
        if not self._stabilized:
            return make_georeferencer(values, self.camera, size)
        return make_georeferencer(values, self.camera, reference_size or size, self._window_H_ref)

    def _use(self, engine: Georeferencer) -> None:
        """Goes on with this engine; frames that wait in the one before are placed by what it knows."""
        if self.engine is not None:
            self._answer(self.engine.finish)
        self.engine = engine
        for sample in self._samples:
            self._feed(engine, sample)
        if self._camera_info is not None:
            self._camera_info.locked = True
        if needs_sensors(self._config):
            for topic in _SENSORS:
                self._await(topic)

    # output ----------------------------------------------------------------------------------------------------------
    def _answer(self, ask: Callable[[], list[Georeferenced]]) -> None:
        """Publishes what the engine answers; frames that it loses by an error are unplaced."""
        engine = self.engine
        assert engine is not None
        found: list[Georeferenced] = []
        reason = ""
        with self._failures:
            try:
                found = ask()
            except InputError as error:
                reason = str(error)
        lost = len(self._pending) - engine.waiting - len(found)
        if lost and not reason:
            self._say_failure()
            reason = self._failures.last
        for _ in range(lost):
            taken = self._pending.popleft()
            self._publish(Georeferenced(taken.frame, self._config.wse_m, Unplaced(reason)), taken.source_ns, engine)
        for one in found:
            self._publish(one, self._pending.popleft().source_ns, engine)

    def _publish(self, one: Georeferenced, source_ns: int, engine: Georeferencer) -> None:
        self.outputs.send(one, None if self._stabilized else self.camera, self._config.orientation)
        self._publish_map(one, engine)
        latency_ns = time.time_ns() - source_ns
        warnings = () if one.placement is None else one.placement.warnings
        values = georeference_values(one, self._config.orientation)
        self.status.on_result(Result(one.frame.stamp_ns, one.reason, warnings, values, latency_ns))
        self.outputs.send_image(one, engine)

    def _publish_map(self, one: Georeferenced, engine: Georeferencer) -> None:
        """The origin, once it is known, and the control points where others are rejected than before."""
        if self._origin is None and engine.local_frame is not None:
            self._origin = engine.local_frame
            self.outputs.send_origin(origin_cdr(one, engine.local_frame))
        if engine.gcps is not None and one.placement is not None and one.placement.rejected != self._rejected:
            self._rejected = one.placement.rejected
            self.outputs.send_gcps(gcps_of_cdr(one, engine.gcps))

    # warnings and diagnostics ----------------------------------------------------------------------------------------
    def _tell_of_reset(self, told: Told) -> None:
        if told.motion is None or told.motion.reset_counter == self._resets:
            return
        self._resets = told.motion.reset_counter
        self._warn("reset", f"homographies begin anew at stamp {told.stamp_ns} ns, with another reference; "
                   f"reset_counter is {self._resets}")

    def _warn(self, kind: str, text: str) -> None:
        """In the next report, and throttled in the log."""
        self.status.warn(kind, text)
        self._warnings.log(kind, text)

    def _report(self) -> None:
        self.status.before, self.status.unmade = self._images.before, self._unmade
        self.status.doubts = () if self.engine is None else self.engine.doubts
        self.publish_diagnostics(self.status.report(self.free.ns))

    # parameters ------------------------------------------------------------------------------------------------------
    def _change(self, changed: dict[str, Value]) -> None:
        values = {**self.values, **changed}
        config = georeference_config(values)
        check_georeference(values)
        engine = None if self.engine is None else self._made(values, self._size)
        self._unmade, self._rejected = "", None
        self.values, self._config, self.status.orientation = values, config, config.orientation
        if engine is not None:
            self._use(engine)
        self._open_inputs()
