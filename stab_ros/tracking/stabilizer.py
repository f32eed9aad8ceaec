"""The tracker: one frame in, its homography to the reference and the warped frame out.

Live and offline call the same `Stabilizer`: its answers depend on the frames alone, never on a clock.
"""

from __future__ import annotations

from collections.abc import Iterable
from enum import Enum

import numpy as np

from stab_ros.core.errors import InputError
from stab_ros.core.gray import GreyRange, grey_range
from stab_ros.core.region import Area
from stab_ros.core.threads import use_threads
from stab_ros.core.timeline import Timeline
from stab_ros.core.types import (
    NO_POINTS,
    Correspondences,
    Fit,
    FloatArray,
    Frame,
    Gray,
    Homography,
    Image,
    LostReason,
    ResetReason,
    Stabilized,
    State,
    Track,
)
from stab_ros.imaging.camera import Camera
from stab_ros.imaging.warp import Allocate, warp
from stab_ros.imaging.window import Window
from stab_ros.tracking.frame_stamp import FrameStamp
from stab_ros.tracking.ground_choice import CompetingHypothesis
from stab_ros.tracking.parallax import Relief
from stab_ros.tracking.preprocessing import Preprocessing
from stab_ros.tracking.rolling_shutter import Swing
from stab_ros.tracking.session import Session
from stab_ros.tracking.settings import StabilizerConfig
from stab_ros.tracking.setup import Setup
from stab_ros.tracking.start_buffer import GroundState
from stab_ros.tracking.state import Event, TrackerState, next_state
from stab_ros.tracking.static_map import StaticMap
from stab_ros.tracking.succession import ESTABLISHED, Rival, is_challenged


class Showing(Enum):
    """What `Stabilizer.warp` shows of a frame."""

    IN_PLACE = "in the place of the reference"
    AS_TAKEN = "as it was taken"
    NOTHING = "nothing"


class Stabilizer:
    """Registers each frame of a stream to one reference frame.

    The reference is the first textured frame. It stays until `reset_reference` is called, or until a frame of
    another size or bit depth arrives. The answers depend on the frames and their stamps alone, never on a clock: live
    and offline processing give the same homographies.

    Either call `answers` for each frame and `finish` at the end, which buffers the frames of the first `start_s`
    seconds until static ground is separated from moving water. Or call `track`, which answers each frame at once.
    """

    def __init__(self, config: StabilizerConfig, area: Area | None = None, camera: Camera | None = None,
                 points_px: FloatArray = NO_POINTS, static_map: StaticMap | None = None) -> None:
        """Prepares for a stream; nothing is computed before its first frame.

        Args:
            config: the settings.
            area: where static ground may be looked for, in the reference; None: everywhere.
            camera: removes lens distortion first; None: the frames have none.
            points_px: (n, 2) float64, the features to use, in px of the reference; none: the method chooses them.
            static_map: where static ground is in the reference; None: the start-up finds out.

        Raises:
            InputError: the method takes no points, or they are too few.
        """
        self._setup = Setup(config, area or Area(), points_px, Preprocessing(camera), static_map)
        use_threads(config.threads)
        self._state = TrackerState.WAITING
        self._session: Session | None = None  # of the last reference, which is the present one unless WAITING
        self._rival: Rival | None = None
        self._given_up = 0
        self._timeline, self._frames = Timeline(), 0

    def step(self, frame: Frame) -> Stabilized:
        """Tracks a frame and warps it: `track` and `warp` in one call.

        Args:
            frame: the next frame of the stream.

        Returns:
            The track, and the warped image (None while lost, if `on_lost` is `drop`).

        Raises:
            InputError: as `track`.
        """
        track = self.track(frame)
        return Stabilized(track, self.warp(frame, track))

    def track(self, frame: Frame) -> Track:
        """Registers a frame to the reference, at once, by what is known of static ground so far.

        The first textured frame becomes the reference, and so does one of another size or bit depth.

        Args:
            frame: the next frame of the stream.

        Returns:
            Its homography and uncertainty, or the state LOST. For the reference: the identity.

        Raises:
            InputError: `roi`, `exclude`, points or the map do not fit the reference, or the camera not the frame.
        """
        self._setup.preprocessing.check_size(frame)
        stamp, session = self._stamped(frame), self._session_of(frame)
        if session is None:
            return self._begin(stamp, frame)
        return self._noted(self._or_by_rival(session, stamp, frame, session.track(stamp, self._gray(frame, session))))

    def answers(self, frame: Frame) -> list[Track]:
        """`track` with a start-up: the answers that are known with this frame, in the order of the stream.

        For `start_s` after a reference there are none; then the buffered frames are answered all at once. Nothing is
        buffered where regions, points or a map say where static ground is.

        Args:
            frame: the next frame of the stream.

        Returns:
            The answers to this frame and to buffered ones before it.

        Raises:
            InputError: as `track`.
        """
        self._setup.preprocessing.check_size(frame)
        session = self._session_of(frame)
        if session is not None and session.ground.buffer is not None:
            self._follow(session, frame)
            return self._finished() if session.ground.buffer.over else []
        late, before = self.finish(), self._session
        track = self.track(frame)
        if self._session is not None and self._session is not before:
            self._begin_buffering(self._session)
        return [*late, track]

    def finish(self) -> list[Track]:
        """Ends the start-up.

        Returns:
            The answers to the frames that are still buffered, by what has been seen so far.
        """
        tracks: list[Track] = []
        while self.buffering:
            tracks += self._finished()
        return tracks

    def pause(self, ended: bool) -> list[Track]:
        """Answers the buffered frames because no frame comes; the start-up goes on with the next frame.

        Args:
            ended: nothing more is expected. Then this is `finish` if enough was seen; else all that moves otherwise
                than the ground counts as a competing hypothesis.

        Returns:
            The answers, marked as provisional where too little was seen.
        """
        if self._session is None or not self.buffering:
            return []
        if self._rival is not None and self._rival.succeeds(self._session):
            return [*self._give_up(self._session, self._rival), *self.pause(ended)]
        tracks = self._session.pause(ended)
        self._rival = None  # it has no answers to frames that have one
        if not self.buffering:
            self._happens(Event.DECIDED)
        return self._all_noted(tracks)

    def fail(self, index: int, stamp_ns: int) -> Track:
        """Answers a frame at which an unforeseen error has ended a call; a start-up begins anew with the next frame.

        Args:
            index: number of the frame in the stream, as `frames` was before it.
            stamp_ns: its header stamp, ns.

        Returns:
            LOST.
        """
        self._rival = None
        self._frames = max(self._frames, index + 1)
        if self._session is not None:
            self._session.ground.buffer = None
        if self._state is TrackerState.STARTING:
            self._happens(Event.RESET)
        return self._noted(self._lost(FrameStamp(index, stamp_ns, self._timeline.now_ns), LostReason.INTERNAL))

    def warp(self, frame: Frame, track: Track, allocate: Allocate = np.empty) -> Image | None:
        """Warps a frame to the reference.

        Args:
            frame: the frame.
            track: the answer to it.
            allocate: makes the array of the result from shape and dtype.

        Returns:
            The stabilised image, in the frame's `warped_encoding`. While LOST what `on_lost` demands; None: nothing.
        """
        image = self._warped(frame, track, allocate)
        if image is None or frame.warped_encoding == frame.encoding:
            return image
        return self._shown(frame).to_8_bit(image)

    def showing(self, track: Track) -> Showing:
        """What `warp` shows, without computing it.

        Args:
            track: the answer to the frame.

        Returns:
            IN_PLACE while TRACKED; while LOST what `on_lost` demands.
        """
        if self._shown_H(track) is not None:
            return Showing.IN_PLACE
        return Showing.AS_TAKEN if self._setup.config.on_lost == "pass" else Showing.NOTHING

    def _shown_H(self, track: Track) -> Homography | None:
        """The homography by which a frame is warped; None: by none."""
        if track.ref_H_cur is None and self._setup.config.on_lost == "hold" and self._present is not None:
            return self._present.motion.last
        return track.ref_H_cur

    def _warped(self, frame: Frame, track: Track, allocate: Allocate) -> Image | None:
        """`warp`, in the frame's own encoding."""
        H = self._shown_H(track)
        if H is None:
            return frame.image if self.showing(track) is Showing.AS_TAKEN else None
        camera, config = self._setup.preprocessing.camera, self._setup.config
        return warp(frame.image, H, frame.size, config.interpolation, camera, config.window, allocate, track.rows)

    def reset_reference(self) -> None:
        """Makes the next textured frame the reference."""
        self._rival = None
        self._happens(Event.RESET)

    def resume(self, reference: Frame, static_map: StaticMap, reset_counter: int) -> None:
        """Continues with the reference of an earlier run.

        Args:
            reference: the frame as it came.
            static_map: where static ground is in it.
            reset_counter: of the earlier run.

        Raises:
            InputError: the settings do not fit this reference, or find too few features in it.
        """
        self._setup.preprocessing.check_size(reference)
        static_map.check_size(reference.size)
        self._timeline.take(reference.stamp_ns)
        session = self._setup.session(reference, static_map, self._timeline.now_ns, reset_counter)
        if session is None:
            raise InputError(f"{self._setup.config.method} finds nothing in the reference of {reference.kind}")
        session.found = ESTABLISHED
        self._session, self._rival = session, None
        self._happens(Event.REFERENCE)

    def reconfigure(self, config: StabilizerConfig, area: Area, points_px: FloatArray = NO_POINTS) -> None:
        """Changes the settings from the next frame on, with the same reference.

        Args:
            config: the settings.
            area: where static ground may be looked for, in the reference.
            points_px: (n, 2) float64, the features to use, in px of the reference; none: the method chooses them.

        Raises:
            InputError: they do not fit the reference, or leave too few features; nothing has changed then.
        """
        setup = self._setup.changed(config, area, points_px)
        if self._present is not None:
            self._present.reconfigure(config, setup.anchors(self._present.reference.frame.size))
        self._rival = None
        use_threads(config.threads)
        self._setup = setup

    @property
    def state(self) -> TrackerState:
        """Whether there is a reference, and what became of the last frame."""
        return self._state

    @property
    def frames(self) -> int:
        """Number of frames so far, answered or not: the index of the next one."""
        return self._frames

    @property
    def buffering(self) -> bool:
        """Whether frames are buffered: `answers`, `pause` or `finish` will answer them."""
        return self._session is not None and self._session.ground.buffer is not None

    @property
    def ground(self) -> GroundState:
        """How far it is known what is static ground in the reference."""
        if self._session is not None and self.buffering:
            return self._session.ground.state
        return GroundState.UNDECIDED if self._present is None else GroundState.DECIDED

    @property
    def window(self) -> Window:
        """The part of the reference that `warp` shows, and its scale."""
        return self._setup.config.window

    @property
    def reference(self) -> Frame | None:
        """The frame that all others are brought back to; None: there is none yet."""
        return None if self._present is None else self._present.reference.frame

    @property
    def reset_counter(self) -> int:
        """How often the reference was replaced, or the choice of ground turned."""
        return 0 if self._session is None else self._session.reset_counter

    @property
    def reset_reason(self) -> ResetReason | None:
        """Why `reset_counter` rose last; None: it has not, as far as is known."""
        return None if self._session is None else self._session.reset_reason

    @property
    def given_up(self) -> int:
        """How many references matched no frame after them, and gave way to a later frame."""
        return self._given_up

    @property
    def keyframes(self) -> int:
        """Number of keyframes, the reference among them; 0 where `reference` is not `keyframe`."""
        return 0 if self._session is None else self._session.keyframes

    @property
    def static_map(self) -> StaticMap | None:
        """Where static ground lies in the reference, as far as it is known; None: there is no reference."""
        return None if self._present is None else self._present.ground.static_map

    @property
    def sensor_fixed_share(self) -> float:
        """Share of the picture, in [0, 1], that is known to be fixed to the camera: an overlay, dirt, hot pixels."""
        return 0.0 if self._present is None else self._present.ground.sensor_fixed_share

    @property
    def copied_share(self) -> float | None:
        """Share of what is tracked, in [0, 1], that the video codec has copied from earlier frames; None: not much."""
        return None if self._present is None else self._present.copied.much

    @property
    def relief(self) -> Relief | None:
        """The parallax that shows that the ground is no plane; None: none is seen."""
        return None if self._present is None else self._present.parallax.relief

    @property
    def swing(self) -> Swing | None:
        """How far rows have swung by a rolling shutter; None: they have not."""
        return None if self._present is None else self._present.rolling_shutter.swing

    @property
    def competing_hypothesis(self) -> CompetingHypothesis | None:
        """Another plane that can be the ground; None: the choice is clear."""
        return None if self._present is None else self._present.ground.competing_hypothesis

    @property
    def last_match(self) -> tuple[Correspondences, Fit | None] | None:
        """The matches of the last frame, and what was fitted to them; None: there are none."""
        return None if self._present is None else self._present.last_match

    @property
    def _present(self) -> Session | None:
        return None if self._state is TrackerState.WAITING else self._session

    def _session_of(self, frame: Frame) -> Session | None:
        """The session that the frame belongs to; None: it is to become the reference."""
        present = self._present
        return present if present is not None and present.reference.frame.is_like(frame) else None

    def _stamped(self, frame: Frame) -> FrameStamp:
        self._timeline.take(frame.stamp_ns)
        self._frames += 1
        return FrameStamp(self._frames - 1, frame.stamp_ns, self._timeline.now_ns)

    def _gray(self, frame: Frame, session: Session) -> Gray:
        return self._setup.preprocessing.gray(frame, session.reference.shown)

    def _shown(self, frame: Frame) -> GreyRange:
        """The range of values in which a frame is shown: that of the reference, if there is one."""
        return grey_range(frame) if self._present is None else self._present.reference.shown

    def _follow(self, session: Session, frame: Frame) -> None:
        """Buffers a frame, also in the rival of the reference; if neither finds it, it becomes the rival."""
        stamp = self._stamped(frame)
        shown = session.follow(stamp, self._gray(frame, session))
        if self._rival is not None:
            self._rival.session.follow(stamp, self._gray(frame, self._rival.session))
        if self._rival is None or not self._rival.is_confirmed:
            self._rival = self._new_rival(stamp, frame) if is_challenged(session, shown) else self._rival
        elif not self._rival.may_succeed(session):
            self._rival = None

    def _finished(self) -> list[Track]:
        """Ends the start-up of the reference, or gives it up; then that of its successor may not be over."""
        assert self._session is not None
        if self._rival is not None and self._rival.succeeds(self._session):
            return self._give_up(self._session, self._rival)
        tracks = self._session.finish()
        self._rival = None
        self._happens(Event.DECIDED)
        return self._all_noted(tracks)

    def _give_up(self, reference: Session, rival: Rival) -> list[Track]:
        """Makes the rival the reference; the answers to the buffered frames up to it."""
        waiting = [] if reference.ground.buffer is None else reference.ground.buffer.unanswered
        before = [stamp for stamp in waiting if stamp.index < rival.stamp.index]
        self._succeeded_by(rival)
        self._happens(Event.BUFFERED)
        lost = [rival.session.lost(stamp, LostReason.NO_FEATURES) for stamp in before]
        return [*lost, rival.session.first(rival.stamp)]

    def _or_by_rival(self, session: Session, stamp: FrameStamp, frame: Frame, track: Track) -> Track:
        """The answer to a frame, by the rival of the reference if that takes over with it."""
        if session.found:
            self._rival = None
            return track
        if self._rival is None:
            self._rival = self._new_rival(stamp, frame)
            return track
        rival = self._rival
        by_rival = rival.session.track(stamp, self._gray(frame, rival.session))
        if rival.succeeds_at_once(session):
            self._succeeded_by(rival)
            return by_rival
        if not rival.is_confirmed:
            self._rival = self._new_rival(stamp, frame)
        return track

    def _new_rival(self, stamp: FrameStamp, frame: Frame) -> Rival | None:
        """The frame as a reference to be, if it can be one."""
        try:
            session = self._new_session(stamp, frame, ResetReason.GIVEN_UP)
        except InputError:  # the user's points do not fit it
            return None
        if session is None or (self.buffering and not session.buffer(self._setup.start_ns, stamp.time_ns)):
            return None
        return Rival(session, stamp)

    def _succeeded_by(self, rival: Rival) -> None:
        self._session, self._rival = rival.session, None
        self._given_up += 1
        self._happens(Event.REFERENCE)

    def _new_session(self, stamp: FrameStamp, frame: Frame, reason: ResetReason) -> Session | None:
        """reason: why the session before it ends, if there is one."""
        counter, why = (0, None) if self._session is None else (self._session.reset_counter + 1, reason)
        return self._setup.session(frame, self._setup.static_map, stamp.time_ns, counter, why)

    def _why_new(self, frame: Frame) -> ResetReason:
        """Why a frame does not belong to the present reference."""
        if self._present is None:
            return ResetReason.ASKED
        return ResetReason.SIZE if self._present.reference.frame.size != frame.size else ResetReason.DEPTH

    def _begin(self, stamp: FrameStamp, frame: Frame) -> Track:
        """Makes the frame the reference if it has enough features."""
        session = self._new_session(stamp, frame, self._why_new(frame))
        if session is None:
            return self._noted(self._lost(stamp, LostReason.NO_TEXTURE))
        self._session, self._rival = session, None
        self._happens(Event.REFERENCE)
        return session.first(stamp)

    def _lost(self, stamp: FrameStamp, reason: LostReason) -> Track:
        """The answer to a frame that no session has registered."""
        if self._present is not None:
            return self._present.lost(stamp, reason)
        return Track(State.LOST, stamp.index, stamp.stamp_ns, 0, self.reset_counter, lost_reason=reason,
                     reset_reason=self.reset_reason)

    def _begin_buffering(self, session: Session) -> None:
        """Buffers the frames from here on, if there is anything to find out about the ground."""
        if self._setup.start_ns and session.buffer(self._setup.start_ns, self._timeline.now_ns):
            self._happens(Event.BUFFERED)

    def _noted(self, track: Track) -> Track:
        self._happens(Event.ACCEPTED if track.tracked else Event.REJECTED)
        return track

    def _all_noted(self, tracks: Iterable[Track]) -> list[Track]:
        return [self._noted(track) for track in tracks]

    def _happens(self, event: Event) -> None:
        self._state = next_state(self._state, event)
