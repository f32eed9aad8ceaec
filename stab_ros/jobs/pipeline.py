"""The steps behind reading: track every picture, write what comes of it. Each step runs on a thread of its own."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable
from contextlib import closing
from dataclasses import dataclass, replace

from stab_ros.core.errors import InputError, MessageError
from stab_ros.core.types import Frame, Image, State, Track
from stab_ros.io.bag import Message
from stab_ros.io.homographies import HomographyWriter
from stab_ros.io.messages import header_of
from stab_ros.io.outgoing_image import OutgoingImage
from stab_ros.io.source import Picture
from stab_ros.io.video_writer import VideoWriter
from stab_ros.jobs.stabilized_bag import StabilizedBag
from stab_ros.jobs.stage import Stage
from stab_ros.tracking.stabilizer import Stabilizer
from stab_ros.tracking.static_map import StaticMap

# called after every frame with how many are done
OnFrame = Callable[[int], None]
# the pictures of the input once more, from a number on
ReadAgain = Callable[[int], Generator[Picture, None, None]]


@dataclass(frozen=True, eq=False)
class TrackedFrame:
    """One picture, its number in the input, and its track.

    image: the picture in the reference's place; None: not wanted. image_cdr: its message. static_map: where
    ground is, if that has become known or has changed with this picture.
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
    """Where results go."""

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
    """What has been written. unused: pictures that cannot be decoded or tracked; `problem` is that of the first."""

    frames: int = 0
    tracked: int = 0
    unused: int = 0
    problem: str = ""

    def add(self, result: TrackedFrame) -> None:
        self.frames += 1
        self.tracked += result.track.tracked
        if not isinstance(result.picture.decoded, Frame):
            self.unused += 1
            self.problem = self.problem or str(result.picture.decoded)


def run(items: Iterable[Picture | Message], stabilizer: Stabilizer, outputs: Outputs, progress: OnFrame,
        read_again: ReadAgain) -> Counts:
    """Reads here, tracks and writes on two more threads, each a frame or two behind the other, all in order."""
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
    return counts


class PictureTracker:
    """The stabilizer over pictures, of which some cannot be used: those are lost, and counted as frames.

    While the stabilizer defers its answers it is led ahead through the pictures, which are not kept but read again;
    so every picture has its answer when its turn comes.
    """

    def __init__(self, stabilizer: Stabilizer, need_image: bool, read_again: ReadAgain) -> None:
        self._stabilizer = stabilizer
        self._need_image = need_image
        self._read_again = read_again
        self._number = -1
        self._ahead: dict[int, Track | InputError] = {}
        self._shown_map: StaticMap | None = None

    @property
    def ahead(self) -> int:
        """How many pictures after the last one are answered already."""
        return len(self._ahead)

    def step(self, picture: Picture) -> TrackedFrame:
        """Raises InputError if what the user gave does not fit the first reference; later that is a picture lost."""
        self._number += 1
        if isinstance(picture.decoded, MessageError):
            return self._result(picture, self._lost(picture))
        track = self._track(picture.decoded)
        if isinstance(track, InputError):
            return self._result(replace(picture, decoded=MessageError(str(track))), self._lost(picture))
        return self._result(picture, track, *(self._warped(picture.decoded, track) if self._need_image else ()))

    def _warped(self, frame: Frame, track: Track) -> tuple[Image | None, bytes | None]:
        """The picture in the reference's place, and its message."""
        message = OutgoingImage(frame.encoding, header_of(frame))
        image = self._stabilizer.warp(frame, track, message.allocate)
        return image, None if image is None else message.cdr(image)

    def _track(self, frame: Frame) -> Track | InputError:
        """The answer for the picture whose turn it is, or why there is none."""
        if self._number in self._ahead:
            return self._ahead.pop(self._number)
        try:
            (track,) = self._stabilizer.answers(frame)
        except InputError as error:
            if self._stabilizer.reference is None:
                raise
            return error
        if self._stabilizer.buffering:
            self._look_ahead()
        return track

    def _look_ahead(self) -> None:
        """Leads the stabilizer on until it has answered everything it has seen."""
        numbers: dict[int, int] = {}  # by index of the stabilizer's frames
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
        size = picture.decoded.size if track.tracked and isinstance(picture.decoded, Frame) else self._reference_size
        return TrackedFrame(self._number, picture, track, image, image_cdr, size, self._new_map(size))

    @property
    def _reference_size(self) -> tuple[int, int] | None:
        reference = self._stabilizer.reference
        return None if reference is None else reference.size

    def _new_map(self, size: tuple[int, int] | None) -> StaticMap | None:
        """The static map of a reference of this size, if it has not been given out yet."""
        static_map = self._stabilizer.static_map
        if static_map is None or static_map is self._shown_map or static_map.size != size:
            return None
        self._shown_map = static_map
        return static_map

    def _lost(self, picture: Picture) -> Track:
        reference = self._stabilizer.reference
        reference_stamp_ns = 0 if reference is None else reference.stamp_ns
        return Track(State.LOST, self._number, picture.stamp_ns, reference_stamp_ns, self._stabilizer.reset_counter)
