"""What nodes that place frames have in common: images, homographies, camera and sensors in, answers out."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Mapping
from typing import TypeAlias

from stab_ros.core.errors import InputError, MessageError
from stab_ros.core.kernels import Compilation
from stab_ros.core.settings import Value
from stab_ros.core.text import counted
from stab_ros.core.timeline import Advance
from stab_ros.georeferencing.georeferencer import Georeferenced, Georeferencer
from stab_ros.georeferencing.level_doubts import missing_level, silent_level, stale_level
from stab_ros.georeferencing.settings import (
    GeoreferenceConfig,
    needs_calibration,
    needs_level,
    needs_motion,
    needs_sensors,
)
from stab_ros.io.attitude_message import Attitude
from stab_ros.io.cdr import SECOND_NS
from stab_ros.io.fix_message import Fix
from stab_ros.io.topics import FIX_TOPIC, STABILIZED_TOPIC, WATER_LEVEL_TOPIC
from stab_ros.io.water_level_message import WaterLevel
from stab_ros.jobs.sensor_feed import Sample
from stab_ros.nodes.camera_info_subscription import CameraInfoSubscription
from stab_ros.nodes.failures import Failures
from stab_ros.nodes.frame_placer import Asked, FramePlacer, KnownCamera, MakeEngine, Taken
from stab_ros.nodes.georeference_status import GeoreferenceStatus
from stab_ros.nodes.image_input import ImageInput
from stab_ros.nodes.level_stamps import LevelStamps
from stab_ros.nodes.managed_node import StabNode
from stab_ros.nodes.missing_publisher import MissingPublisher
from stab_ros.nodes.motion_input import MotionInput, Told
from stab_ros.nodes.patience import Patience
from stab_ros.nodes.received_image import ReceivedImage
from stab_ros.nodes.sensor_inputs import SensorInputs
from stab_ros.nodes.stamp_monitor import StampMonitor
from stab_ros.nodes.stamp_pairing import Pair, StampPairing
from stab_ros.nodes.throttled_warnings import ThrottledWarnings
from stab_ros.parameters.node_settings import PlacingSettings

_SENSORS = (FIX_TOPIC, "attitude")  # which frames wait for in the engine
_LENS = ("the tracker does not remove the distortion of this lens, its homographies are not exact; start it with "
         "use_camera_info:=true")

_Paired: TypeAlias = "Pair[Taken, Told]"


class PlacingNode(StabNode):
    """Places every image; what becomes of the answers is told by the subclass.

    settings: of the node. values: parameters of its engines. status: counts what becomes of images.
    """

    COMPUTES = TAKES_IMAGES = True
    settings: PlacingSettings

    def begin(self, values: Mapping[str, Value], config: GeoreferenceConfig, status: GeoreferenceStatus,
              make_engine: MakeEngine, level_given: bool) -> None:
        """Prepares all inputs; called by `configure` of the subclass, which has set `settings`.

        Args:
            values: parameters of the engines, checked.
            config: of georeferencing.
            status: to count in.
            make_engine: of placing.
            level_given: whether parameters tell a water level.
        """
        self.values, self._config, self.status = dict(values), config, status
        self._level_given, self._levels = level_given, LevelStamps()
        self._stabilized = self.settings.input == STABILIZED_TOPIC
        self._camera_info = CameraInfoSubscription(
            self, self._use_camera, lambda: needs_calibration(self._config)) if self.takes_camera_info else None
        self._images = ImageInput(
            self, compressed=self.settings.image_transport == "compressed", keep_all=self.settings.queue_depth == 0,
            may_pass=self._knows_camera, take=self._on_image, dropped=self._on_dropped, topic=self.settings.input)
        self._motions: MotionInput | None = None
        self._sensors = SensorInputs(self, self.settings, self)
        self._frames: StampPairing[Taken, Told] = StampPairing(
            self.settings.backlog_mb * 1e6, lambda taken: taken.frame.image.nbytes)
        self._newest_ns = -1  # stamp of the newest frame; -1: none has come
        self._resets = 0  # as far as they were said
        self._patience: dict[str, Patience] = {}  # with the topics that frames wait for
        self._missing: dict[str, MissingPublisher] = {}  # of those
        self._warnings = ThrottledWarnings(self.get_logger())
        self._stamps, self.failures = StampMonitor(), Failures(self.get_logger())
        self.placer = FramePlacer(values, self._stabilized, self._known_camera, self.failures, self, make_engine)

    @property
    @abstractmethod
    def subscribers(self) -> int:
        """To the topic that `wait_for_subscribers` is about."""

    @property
    @abstractmethod
    def awaited_topic(self) -> str:
        """The topic that `wait_for_subscribers` is about."""

    @abstractmethod
    def on_answer(self, answer: Georeferenced, asked: Asked, engine: Georeferencer) -> None:
        """See `PlacerCallbacks`."""

    # lifecycle -------------------------------------------------------------------------------------------------------
    def on_compilation(self, progress: Compilation) -> None:
        self.status.waiting_for = progress.awaited

    def activate(self) -> None:
        self._open_inputs()

    def deactivate(self) -> None:
        """Places the frames that wait by what is there; the map stays."""
        self._images.close()
        self.status.timeout.suspend()
        self._stamps.suspend()
        if self._motions is not None:
            self._motions.close()
            self._patience.pop(self._motions.topic, None)
        self._place(self._frames.flush())
        self.placer.finish()
        self._motions = None

    def on_failure(self, error: BaseException) -> None:
        if not isinstance(error, Exception):
            raise error
        self.failures.note(error)

    def refresh(self) -> None:
        """Follows the publishers of what the subclass takes beside; called ten times a second."""

    # what is taken ---------------------------------------------------------------------------------------------------
    @property
    def takes_camera_info(self) -> bool:
        """Whether images wait for the calibration."""
        return self.settings.use_camera_info and not self.values.get("camera_file") and not self._stabilized

    @property
    def takes_level(self) -> bool:
        """Whether frames lie on the water: not so where lengths are pixels."""
        return True

    @property
    def takes_motion(self) -> bool:
        """Whether frames wait for homographies."""
        return self._stabilized or self.settings.use_homographies or needs_motion(self._config)

    def _knows_camera(self) -> bool:
        """Whether images can be placed: no camera_info is needed, or it is known, or they go without."""
        info = self._camera_info
        return info is None or info.camera is not None or info.given_up

    def _known_camera(self) -> KnownCamera:
        if self._stabilized:
            motions = self._motions
            return KnownCamera(None) if motions is None else KnownCamera(motions.camera, motions.reference_size)
        return KnownCamera(None if self._camera_info is None else self._camera_info.camera)

    def _use_camera(self) -> None:
        """The camera has become known, or is another one as long as no frame was placed."""
        self.placer.retry()
        self._images.release()

    def poll(self) -> None:
        """Follows the publishers, starts to take images once subscribers are there, gives up waiting for the silent."""
        self._sensors.refresh()
        self.status.faults = self._sensors.faults
        if self._camera_info is not None:
            self._camera_info.refresh(self._images.held_up)
        if self._motions is not None:
            self._motions.refresh()
        self.refresh()
        if self._images.is_open:
            self._images.refresh()
            self._tell_missing()
            self.status.waiting_for = self._awaited()
            self._give_up_waiting()
        elif self.subscribers >= self.settings.wait_for_subscribers:
            self._open()
        else:
            subscribers = counted(self.settings.wait_for_subscribers, "subscriber")
            self.status.waiting_for = f"{subscribers} of {self.awaited_topic}"

    def _open(self) -> None:
        self._images.open()
        self._open_inputs()
        self.status.waiting_for = self._awaited()

    def _awaited(self) -> str:
        """What the first frame waits for, for people."""
        camera = "" if self._camera_info is None else self._camera_info.awaited
        if self._images.held_up:
            return camera
        late = [self._told_of(topic) for topic in self._patience if self._is_awaited(topic)]
        return " and ".join(filter(None, late or [self._images.awaited, camera]))

    def _open_inputs(self) -> None:
        """Subscribes to what the orientation takes, once: it may be changed, and changed back."""
        if needs_sensors(self._config):
            self._sensors.open_attitude()
            for topic in _SENSORS:
                self._await(topic)
        if self.takes_motion and self._motions is None and self._images.is_open:
            self._motions = MotionInput(self, self._on_told, lambda text: self.on_unusable("", text))
            self._await(self._motions.topic)

    # input -----------------------------------------------------------------------------------------------------------
    def _on_dropped(self, images: int) -> None:
        self.status.count("frames_dropped", images)

    def _on_image(self, image: ReceivedImage) -> None:
        try:
            frame = image.frame()
        except MessageError as error:
            self.status.count("frames_refused")
            self.warn("refused", f"refused an image: {error}")
            return
        if self._stamps.is_duplicate(frame.stamp_ns):
            self._on_dropped(1)
            return
        self._take_stamp(frame.stamp_ns)
        self.status.on_image(self.free.ns)
        self._newest_ns = frame.stamp_ns
        self._tell_level(self._levels.advance(frame.stamp_ns))
        taken = Taken(frame, image.source_ns)
        if self.takes_motion:
            self._place(self._frames.ask(frame.stamp_ns, taken))
        else:
            self._place([Pair(frame.stamp_ns, taken, None)])

    def _take_stamp(self, stamp_ns: int) -> None:
        """Where stamps go back, samples with later ones are of another time: none of them tells of what comes now."""
        step = self._stamps.take(stamp_ns)
        text = self._stamps.words(step)
        if text:
            self.warn(step.value, text)
        if step is Advance.BACK or 0 < stamp_ns < self._newest_ns:
            self.status.restart()
            if needs_sensors(self._config):
                self.placer.begin_anew(stamp_ns)

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
        self._tell_level(self._levels.stamped(level))

    def _tell_level(self, level: WaterLevel | None) -> None:
        if level is not None:
            self._on_sample(WATER_LEVEL_TOPIC, level)

    def on_unusable(self, topic: str, text: str) -> None:
        """See `SensorCallbacks`."""
        self.status.count("messages_refused")
        self.warn(f"unusable {topic}", f"refused a message: {topic}{topic and ': '}{text}")

    def on_doubt(self, topic: str, text: str) -> None:
        """See `SensorCallbacks`."""
        self.warn(f"doubt {topic}", f"{topic}: {text}")

    def _on_sample(self, topic: str, sample: Sample) -> None:
        applied_s = self.placer.time_offset_s
        offset_s = self._config.time_offset_s if applied_s is None else applied_s
        offset_ns = 0 if isinstance(sample, WaterLevel) else round(offset_s * SECOND_NS)
        self.status.on_sample(topic, sample.stamp_ns + offset_ns)
        self._heard(topic)
        self.placer.add(sample)

    # silence ---------------------------------------------------------------------------------------------------------
    def _await(self, topic: str) -> None:
        """Frames wait for messages of this topic from now on."""
        self._patience.setdefault(topic, Patience(round(self.settings.wait_s * SECOND_NS)))

    def _tell_missing(self) -> None:
        """That nobody publishes what frames wait for, once for each topic."""
        for topic in self._patience:
            missing = self._missing.setdefault(topic, MissingPublisher(self.get_logger()))
            missing.look(self._is_awaited(topic), self._publishers_of(topic),
                         f"nobody publishes {self._name_of(topic)}: frames wait for it up to "
                         f"{self.settings.wait_s:g} s (wait_s), then they go without")

    def _told_of(self, topic: str) -> str:
        """That frames wait for it, for people."""
        return f"messages on {self._name_of(topic)}" + ("" if self._publishers_of(topic) else ", nobody publishes it")

    def _name_of(self, topic: str) -> str:
        """Full names, for people."""
        return " or ".join(one.topic for one in self._sensors.sources(topic)) if topic in _SENSORS else topic

    def _publishers_of(self, topic: str) -> int:
        if topic in _SENSORS:
            return sum(one.publishers for one in self._sensors.sources(topic))
        return 0 if self._motions is None else self._motions.publishers

    def _heard(self, topic: str) -> None:
        if topic in self._patience:
            self._patience[topic].heard(self.free.ns)

    def _give_up_waiting(self) -> None:
        """Places the frames that wait for what has fallen silent, by what is there."""
        motions, silent = self._motions, self._silent()
        if motions is not None and motions.topic in silent and len(self._frames):
            motions.flush()
            self._place(self._frames.flush())
        if any(topic in silent for topic in _SENSORS):
            self.placer.finish()
        self.status.silent, self.status.waiting = silent, len(self._frames) + self.placer.waiting

    def _silent(self) -> tuple[str, ...]:
        """The topics that frames wait for in vain."""
        return tuple(topic for topic, patience in self._patience.items()
                     if patience.check(self.free.ns, self._is_awaited(topic)))

    def _is_awaited(self, topic: str) -> bool:
        """Whether a frame waits for a message of this topic."""
        if topic not in _SENSORS:
            return len(self._frames) > 0
        oldest_ns = self.placer.oldest_ns
        return oldest_ns is not None and self.status.newest_ns(topic) < oldest_ns

    # placing and output ----------------------------------------------------------------------------------------------
    def _place(self, pairs: list[_Paired]) -> None:
        for pair in pairs:
            try:
                self.placer.place(pair.question, pair.answer)
            except InputError as error:
                self.status.count("frames_refused")
                self.warn("refused", f"refused an image: {error}")
                continue
            if self._camera_info is not None:
                self._camera_info.locked = True
            if pair.answer is not None:
                self._tell_of_reset(pair.answer)

    # warnings and diagnostics ----------------------------------------------------------------------------------------
    def _tell_of_reset(self, told: Told) -> None:
        if told.motion is None or told.motion.reset_counter == self._resets:
            return
        self._resets = told.motion.reset_counter
        self.warn("reset", f"homographies begin anew at stamp {told.stamp_ns} ns, with another reference; "
                   f"reset_counter is {self._resets}")

    def warn(self, kind: str, text: str) -> None:
        """In the next report, and throttled in the log."""
        self.status.warn(kind, text)
        self._warnings.log(kind, text)

    @property
    def _lens_is_left(self) -> bool:
        """Whether homographies are of distorted pixels, though the distortion is known."""
        camera, motions = self.placer.camera, self._motions
        if self._stabilized or camera is None or motions is None or motions.reference_size is None:
            return False
        return camera.distorts and motions.camera is None

    @property
    def _level_doubts(self) -> tuple[str, ...]:
        """That there is no water level under the newest frame, or a stale one; in one line, if any."""
        if self._newest_ns < 0 or not self.takes_level:
            return ()
        age_s = (self._newest_ns - self.status.newest_ns(WATER_LEVEL_TOPIC)) / SECOND_NS
        if math.isfinite(age_s):
            return stale_level(age_s, self.settings.water_level_timeout_s)
        if self._sensors.level.publishers:
            return (silent_level(self._sensors.level.topic, self._wse_m),)
        needed = needs_level(self._config) and not self._level_given
        return (missing_level(self._wse_m),) if needed else ()

    @property
    def _wse_m(self) -> float:
        """That of the settings, m."""
        return self._config.wse_m if self.placer.engine is None else self.placer.engine.wse_m

    def report(self) -> None:
        """Publishes /diagnostics."""
        of_level = self._level_doubts
        self.status.before, self.status.unmade = self._images.before, self.placer.unmade
        of_engine = () if self.placer.engine is None else self.placer.engine.doubts
        self.status.doubts = (*of_engine, *([_LENS] if self._lens_is_left else []), *of_level)
        for doubt in of_level:
            self._warnings.log("water level", doubt)
        if self.failures.count > self.status.errors:
            self.status.errors = self.failures.count
            self.status.warn("internal", self.failures.last)
        self.publish_diagnostics(self.status.report(self.free.ns))

    def go_on_with(self, values: Mapping[str, Value], config: GeoreferenceConfig) -> None:
        """Goes on with other parameters.

        Raises:
            InputError: they make no engine; nothing has changed.
        """
        self.placer.change(values)
        self.values, self._config, self.status.orientation = dict(values), config, config.orientation
        self._open_inputs()
