"""Reading, tracking and writing of every frame, each on its own thread."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Generator, Iterable
from contextlib import closing
from dataclasses import dataclass, field, replace

from stab_ros.core.errors import InputError, MessageError
from stab_ros.core.types import Frame, Image, LostReason, State, Track
from stab_ros.io.advice import FixedToCamera, Reset
from stab_ros.io.bag import Message
from stab_ros.io.cdr import header_of
from stab_ros.io.homographies import HomographyWriter
from stab_ros.io.outgoing_image import OutgoingImage
from stab_ros.io.source import Picture
from stab_ros.io.video_writer import VideoWriter
from stab_ros.jobs.stabilized_bag import StabilizedBag
from stab_ros.jobs.stage import Stage
from stab_ros.tracking.stabilizer import Stabilizer
from stab_ros.tracking.static_map import StaticMap

# called after every frame with the number of frames done
OnFrame = Callable[[int], None]
# reads the input again, from a frame number on
ReadAgain = Callable[[int], Generator[Picture, None, None]]


@dataclass(frozen=True, eq=False)
class TrackedFrame:
    """One frame, its number in the input, and its track.

    image: the frame warped to the reference; None: not needed. image_cdr: its message. static_map: the new static map,
    if this frame has changed it.
    """

    number: int
    picture: Picture
    track: Track
    image: Image | None
    image_cdr: bytes | None
    reference_size: tuple[int, int] | None
    static_map: StaticMap | None = None


@dataclass(frozen=True)
class Outputs:
    """The writers of the outputs."""

    bag: StabilizedBag
    table: HomographyWriter | None
    video: VideoWriter | None

    @property
    def need_image(self) -> bool:
        return self.bag.with_image or self.video is not None

    def write(self, result: TrackedFrame) -> None:
        frame = result.picture.decoded
        self.bag.write(result.picture, result.track, result.image_cdr, result.reference_size, result.static_map)
        if self.table is not None:
            self.table.write(result.number, result.track)
        if self.video is not None:
            self.video.write(frame if isinstance(frame, Frame) else None, result.image)


@dataclass
class Counts:
    """Numbers of written frames.

    lost: by reason. simpler: with a simpler model than asked for. resets: where homographies begin anew. problem: of
    the first that cannot be decoded or tracked. notes: what was found out on the way.
    """

    frames: int = 0
    lost: Counter[LostReason] = field(default_factory=Counter)
    simpler: int = 0
    resets: list[Reset] = field(default_factory=list)
    reset_counter: int = 0  # of the last tracked frame
    problem: str = ""
    notes: tuple[str, ...] = ()

    def add(self, result: TrackedFrame) -> None:
        self.frames += 1
        if result.track.lost_reason is not None:
            self.lost[result.track.lost_reason] += 1
        self.simpler += bool(result.track.simpler_model)
        if not isinstance(result.picture.decoded, Frame):
            self.problem = self.problem or str(result.picture.decoded)
        elif result.track.tracked and result.track.reset_counter != self.reset_counter:
            self.resets.append(Reset(result.number, result.track.reset_reason, result.picture.decoded.kind))
            self.reset_counter = result.track.reset_counter


def run(items: Iterable[Picture | Message], stabilizer: Stabilizer, outputs: Outputs, progress: OnFrame,
        read_again: ReadAgain) -> Counts:
    """Reads on this thread, tracks and writes on two others, each up to two frames behind, all in order."""
    tracker, counts = PictureTracker(stabilizer, outputs.need_image, read_again), Counts()

    def write(item: TrackedFrame | Message) -> None:
        if isinstance(item, Message):
            outputs.bag.take_over(item)
            return
        outputs.write(item)
        counts.add(item)
        progress(counts.frames)

    def track(item: Picture | Message) -> None:
        writing.put(item if isinstance(item, Message) else tracker.step(item))

    with Stage(write) as writing, Stage(track) as tracking:
        for item in items:
            tracking.put(item)
    counts.notes = tuple(tracker.notes)
    return counts


class PictureTracker:
    """Runs the stabilizer over all frames; undecodable ones count as lost frames.

    While the stabilizer fills its start-up buffer, it runs ahead through the input; the frames are not kept but read
    again. So every frame has its track when its turn comes. notes: what it has found out that the user should know.
    """

    def __init__(self, stabilizer: Stabilizer, need_image: bool, read_again: ReadAgain) -> None:
        self._stabilizer = stabilizer
        self._need_image = need_image
        self._read_again = read_again
        self._number = -1
        self._ahead: dict[int, Track | InputError] = {}
        self._last: Track | None = None  # of the frame before
        self._shown_map: StaticMap | None = None
        self._fixed = FixedToCamera()
        self.notes: list[str] = []

    @property
    def ahead(self) -> int:
        """Number of frames after the current one whose track is known already."""
        return len(self._ahead)

    @property
    def static_map(self) -> StaticMap | None:
        """Where static ground lies in the reference; None: not known yet."""
        return self._stabilizer.static_map

    def step(self, picture: Picture) -> TrackedFrame:
        """Tracks the next frame.

        Raises:
            InputError: a region or a point of the user does not fit the first reference; later such a frame is lost.
        """
        self._number += 1
        if isinstance(picture.decoded, MessageError):
            return self._result(picture, self._lost(picture))
        track = self._track(picture.decoded)
        self._note(self._fixed.news(self._stabilizer.reference, self._stabilizer.sensor_fixed_share))
        if isinstance(track, InputError):
            return self._result(replace(picture, decoded=MessageError(str(track))), self._lost(picture))
        return self._result(picture, track, *(self._warped(picture.decoded, track) if self._need_image else ()))

    def _note(self, news: str) -> None:
        if news:
            self.notes.append(news)

    def _warped(self, frame: Frame, track: Track) -> tuple[Image | None, bytes | None]:
        """The frame warped to the reference, and its message."""
        message = OutgoingImage(frame.warped_encoding, header_of(frame))
        image = self._stabilizer.warp(frame, track, message.allocate)
        return image, None if image is None else message.cdr(image)

    def _track(self, frame: Frame) -> Track | InputError:
        """The track of the current frame, or why it has none."""
        if self._number in self._ahead:
            return self._ahead.pop(self._number)
        try:
            (track,) = self._stabilizer.answers(frame)
        except InputError as error:
            if self._stabilizer.reference is None:
                raise
            return error
        if self._stabilizer.buffering:
            self._run_ahead()
        return track

    def _run_ahead(self) -> None:
        """Runs the stabilizer ahead until its start-up buffer is empty."""
        numbers: dict[int, int] = {}  # of the input, by index of the stabilizer
        with closing(self._read_again(self._number + 1)) as pictures:
            for number, picture in enumerate(pictures, self._number + 1):
                if isinstance(picture.decoded, Frame):
                    numbers[self._stabilizer.frames] = number
                    self._take(number, self._answers(picture.decoded), numbers)
                if not self._stabilizer.buffering:
                    return
        self._take(self._number, self._stabilizer.finish(), numbers)

    def _answers(self, frame: Frame) -> list[Track] | InputError:
        try:
            return self._stabilizer.answers(frame)
        except InputError as error:
            return error

    def _take(self, number: int, answers: list[Track] | InputError, numbers: dict[int, int]) -> None:
        if isinstance(answers, InputError):
            self._ahead[number] = answers
            return
        for track in answers:
            self._ahead[numbers[track.index]] = track

    def _result(self, picture: Picture, track: Track, image: Image | None = None,
                image_cdr: bytes | None = None) -> TrackedFrame:
        self._last = track
        size = picture.decoded.size if track.tracked and isinstance(picture.decoded, Frame) else self._reference_size
        return TrackedFrame(self._number, picture, track, image, image_cdr, size, self._new_map(size))

    @property
    def _reference_size(self) -> tuple[int, int] | None:
        reference = self._stabilizer.reference
        return None if reference is None else reference.size

    def _new_map(self, size: tuple[int, int] | None) -> StaticMap | None:
        """The static map of a reference of this size, unless it has been returned before."""
        static_map = self._stabilizer.static_map
        if static_map is None or static_map is self._shown_map or static_map.size != size:
            return None
        self._shown_map = static_map
        return static_map

    def _lost(self, picture: Picture) -> Track:
        """The stabilizer may be ahead, so the frame belongs to the reference of the one before it."""
        lost = Track(State.LOST, self._number, picture.stamp_ns, 0, 0, lost_reason=LostReason.UNUSABLE)
        return lost if self._last is None else replace(
            lost, reference_stamp_ns=self._last.reference_stamp_ns, reset_counter=self._last.reset_counter,
            reset_reason=self._last.reset_reason)
