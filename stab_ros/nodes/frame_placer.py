"""The engine of the georeference node, with the frames that wait in it and the samples that it was told."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Protocol, TypeAlias

import numpy as np

from stab_ros.core.errors import InputError
from stab_ros.core.settings import Value
from stab_ros.core.types import Frame, Homography
from stab_ros.georeferencing.georeferencer import Georeferenced, Georeferencer
from stab_ros.georeferencing.local_frame import LocalFrame
from stab_ros.georeferencing.orientation import Unplaced
from stab_ros.georeferencing.placement import Motion
from stab_ros.imaging.camera import Camera
from stab_ros.io.fix_message import Fix
from stab_ros.io.topics import FIX_TOPIC
from stab_ros.jobs.sensor_feed import Sample, tell
from stab_ros.nodes.failures import Failures
from stab_ros.nodes.motion_input import Told
from stab_ros.parameters.engines import camera_of, make_georeferencer

# the engine of parameters, camera, width and height of images as taken, and `image_H_ref`
MakeEngine: TypeAlias = Callable[
    [Mapping[str, Value], Camera | None, tuple[int, int], Homography | None], Georeferencer]
_SAMPLES = 20_000  # of sensors that are kept for another engine


@dataclass(frozen=True, eq=False)
class Taken:
    """A frame that has no answer yet, and when its image was published."""

    frame: Frame
    source_ns: int


@dataclass(frozen=True, eq=False)
class Asked:
    """A frame that the engine was asked for. source_ns: when its image was published. motion: None, lost or unknown."""

    frame: Frame
    source_ns: int
    motion: Motion | None


@dataclass(frozen=True, eq=False)
class KnownCamera:
    """What messages tell of the camera. camera: None, of unknown calibration. reference_size: None, not known."""

    camera: Camera | None
    reference_size: tuple[int, int] | None = None


class PlacerCallbacks(Protocol):
    """Who takes the answers."""

    def on_answer(self, answer: Georeferenced, asked: Asked, engine: Georeferencer) -> None:
        """Of each frame, in order."""

    def on_unusable(self, topic: str, text: str) -> None:
        """A sample that the engine refuses, and why."""


class FramePlacer:
    """Places frames with an engine that is made for the first of them, and anew where settings or the stream change.

    engine: None before the first frame. unmade: why it cannot be made, "" if it can. camera: that took the images;
    None: of unknown calibration. origin: of the map, which stays once it is known.
    """

    def __init__(self, values: Mapping[str, Value], stabilized: bool, known: Callable[[], KnownCamera],
                 failures: Failures, callbacks: PlacerCallbacks, make: MakeEngine = make_georeferencer) -> None:
        """Prepares; the engine is made for the first frame.

        Args:
            values: parameters that were given.
            stabilized: whether images are.
            known: what messages tell so far.
            failures: where errors of the engine are noted.
            callbacks: who takes the answers.
            make: makes an engine, as `make_georeferencer` does.
        """
        self.engine: Georeferencer | None = None
        self.unmade = ""
        self.camera: Camera | None = None
        self.origin: LocalFrame | None = None
        self._values, self._stabilized, self._known = values, stabilized, known
        self._failures, self._callbacks, self._make = failures, callbacks, make
        self._pending: deque[Asked] = deque()  # in the engine
        self._samples: deque[Sample] = deque(maxlen=_SAMPLES)
        self._size = (0, 0)  # of the last frame
        self._window_H_ref: Homography = np.eye(3)  # of image_stabilized

    @property
    def image_H_ref(self) -> Homography | None:
        """From pixels of the reference to those of images that are stabilised; None: they are as taken."""
        return self._window_H_ref if self._stabilized else None

    @property
    def waiting(self) -> int:
        """Number of frames that wait for sensors."""
        return len(self._pending)

    @property
    def oldest_ns(self) -> int | None:
        """Stamp of the first frame that waits."""
        return self._pending[0].frame.stamp_ns if self._pending else None

    def place(self, taken: Taken, told: Told | None) -> None:
        """Places a frame, or has it wait.

        Raises:
            InputError: the frame does not fit the camera, or there is no engine (`unmade`).
        """
        self._size = taken.frame.size
        engine = self._engine_for(told)
        motion = None if told is None else told.motion
        engine.add_frame(taken.frame, motion)
        self._pending.append(Asked(taken.frame, taken.source_ns, motion))
        self._answer(engine, engine.answers)

    def add(self, sample: Sample) -> None:
        """Tells a sample, and answers the frames that waited for it."""
        self._samples.append(sample)
        if self.engine is not None:
            self._feed(self.engine, sample)
            self._answer(self.engine, self.engine.answers)

    def finish(self) -> None:
        """Places the frames that wait, by what is known."""
        if self.engine is not None:
            self._answer(self.engine, self.engine.finish)

    def begin_anew(self, stamp_ns: int) -> None:
        """Time has gone back to this stamp: later samples are of another time. The next frame has another engine."""
        self.finish()
        self.engine = None
        self._samples = deque((one for one in self._samples if one.stamp_ns <= stamp_ns), maxlen=_SAMPLES)

    def retry(self) -> None:
        """What made an engine impossible may have changed."""
        self.unmade = ""

    def change(self, values: Mapping[str, Value]) -> None:
        """Goes on with other parameters.

        Raises:
            InputError: they make no engine; nothing has changed.
        """
        engine = None if self.engine is None else self._made(values)
        self._values, self.unmade = values, ""
        if engine is not None:
            self._use(engine)

    # engines ---------------------------------------------------------------------------------------------------------
    def _engine_for(self, told: Told | None) -> Georeferencer:
        """The engine; made for the first frame, and anew where image_stabilized shows another window."""
        window_H_ref = self._window_H_ref if told is None else told.window_H_ref
        moved = self._stabilized and not np.array_equal(window_H_ref, self._window_H_ref)
        if self.engine is not None and not moved:
            return self.engine
        if self.unmade:
            raise InputError(self.unmade)
        self._window_H_ref = window_H_ref
        try:
            return self._use(self._made(self._values))
        except InputError as error:
            self.unmade = str(error)
            raise

    def _made(self, values: Mapping[str, Value]) -> Georeferencer:
        known = self._known()
        if self.origin is not None:
            place = (self.origin.latitude_deg, self.origin.longitude_deg, self.origin.height_m)
            values = {**values, "origin": ", ".join(map(repr, place))}
        if self._stabilized:
            return self._make(values, known.camera, known.reference_size or self._size, self._window_H_ref)
        return self._make(values, known.camera, self._size, None)

    def _use(self, engine: Georeferencer) -> Georeferencer:
        """Goes on with this engine; frames that wait in the one before are placed by what that knows."""
        self.finish()
        self.engine = engine
        file = None if self._stabilized else camera_of(self._values, self._size)[0]
        self.camera = self._known().camera if file is None else file.camera
        for sample in self._samples:
            self._feed(engine, sample)
        return engine

    # samples and answers ---------------------------------------------------------------------------------------------
    def _feed(self, engine: Georeferencer, sample: Sample) -> None:
        try:
            tell(engine, sample)
        except InputError as error:
            if not isinstance(sample, Fix):
                raise
            self._callbacks.on_unusable(FIX_TOPIC, str(error))

    def _answer(self, engine: Georeferencer, ask: Callable[[], list[Georeferenced]]) -> None:
        """Passes on what the engine answers; frames that it loses by an error are unplaced."""
        found, reason = list[Georeferenced](), ""
        with self._failures:
            try:
                found = ask()
            except InputError as error:
                reason = str(error)
        for _ in range(len(self._pending) - engine.waiting - len(found)):
            asked = self._pending.popleft()
            lost = Georeferenced(asked.frame, engine.wse_m, Unplaced(reason or self._failures.last))
            self._callbacks.on_answer(lost, asked, engine)
        for one in found:
            self._callbacks.on_answer(one, self._pending.popleft(), engine)
