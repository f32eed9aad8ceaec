"""The steps behind reading: track every picture, write what comes of it. Each step runs on a thread of its own."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

from stab_ros.core.errors import InputError, MessageError
from stab_ros.core.stabilizer import Stabilizer
from stab_ros.core.types import Frame, Image, State, Track
from stab_ros.io.bag import Message
from stab_ros.io.homographies import HomographyWriter
from stab_ros.io.overlap import Stage
from stab_ros.io.source import Picture
from stab_ros.io.stabilized_bag import StabilizedBag
from stab_ros.io.video_writer import VideoWriter

# called after every frame with how many are done
Progress = Callable[[int], None]


@dataclass(frozen=True, eq=False)
class Result:
    """One picture, its number in the input, its track, and the picture in the reference's place (None: not wanted)."""

    number: int
    picture: Picture
    track: Track
    image: Image | None
    reference_size: tuple[int, int] | None


@dataclass(frozen=True)
class Outputs:
    """Where results go."""

    bag: StabilizedBag
    table: HomographyWriter | None
    video: VideoWriter | None

    @property
    def need_image(self) -> bool:
        return self.bag.with_image or self.video is not None

    def write(self, result: Result) -> None:
        frame = result.picture.decoded
        self.bag.write(result.picture, result.track, result.image, result.reference_size)
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

    def add(self, result: Result) -> None:
        self.frames += 1
        self.tracked += result.track.tracked
        if not isinstance(result.picture.decoded, Frame):
            self.unused += 1
            self.problem = self.problem or str(result.picture.decoded)


def run(items: Iterable[Picture | Message], stabilizer: Stabilizer, outputs: Outputs, progress: Progress) -> Counts:
    """Reads here, tracks and writes on two more threads, each a frame or two behind the other, all in order."""
    tracker, counts = PictureTracker(stabilizer, outputs.need_image), Counts()

    def write(item: Result | Message) -> None:
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
    """The stabilizer over pictures, of which some cannot be used: those are lost, and counted as frames."""

    def __init__(self, stabilizer: Stabilizer, need_image: bool) -> None:
        self._stabilizer = stabilizer
        self._need_image = need_image
        self._number = -1

    def step(self, picture: Picture) -> Result:
        """Raises InputError if what the user gave does not fit the first reference; later that is a picture lost."""
        self._number += 1
        if isinstance(picture.decoded, MessageError):
            return self._result(picture, self._lost(picture), None)
        try:
            track = self._stabilizer.track(picture.decoded)
        except InputError as error:
            if self._stabilizer.reference is None:
                raise
            return self._result(replace(picture, decoded=MessageError(str(error))), self._lost(picture), None)
        image = self._stabilizer.warp(picture.decoded, track) if self._need_image else None
        return self._result(picture, track, image)

    def _result(self, picture: Picture, track: Track, image: Image | None) -> Result:
        reference = self._stabilizer.reference
        return Result(self._number, picture, track, image, None if reference is None else reference.size)

    def _lost(self, picture: Picture) -> Track:
        reference = self._stabilizer.reference
        reference_stamp_ns = 0 if reference is None else reference.stamp_ns
        return Track(State.LOST, self._number, picture.stamp_ns, reference_stamp_ns, self._stabilizer.reset_counter)
