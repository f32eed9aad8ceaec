"""The work of georeferencing on every picture: its motion, its place, its orthophoto."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass

from stab_ros.core.errors import MessageError
from stab_ros.core.types import Frame
from stab_ros.georeferencing.georeferencer import Georeferenced, Georeferencer
from stab_ros.georeferencing.placement import Motion
from stab_ros.imaging.camera import Camera
from stab_ros.io.cdr import header_of
from stab_ros.io.frame_reader import Decoded
from stab_ros.io.outgoing_image import OutgoingImage
from stab_ros.io.source import Picture
from stab_ros.jobs.geotiffs import GeoTiffs
from stab_ros.jobs.motions import MotionOf


@dataclass(frozen=True, eq=False)
class Work:
    """What works on the pictures of one size.

    camera: of the images; None: of unknown K. geotiffs: None: none are wanted.
    """

    engine: Georeferencer
    camera: Camera | None
    motion_of: MotionOf
    geotiffs: GeoTiffs | None


# begins for images of this width and height, px
Begin = Callable[[tuple[int, int]], Work]


@dataclass(frozen=True, eq=False)
class PlacedPicture:
    """A picture with its answer, and its number in the input.

    motion: how it lies to the reference; None: lost, or not stabilised. image: the message of its orthophoto.
    """

    number: int
    work: Work
    picture: Picture
    motion: Motion | None
    answer: Georeferenced
    image: bytes | None


class PicturePlacer:
    """Runs the engine over all pictures; those that cannot be decoded have no answer (`undecoded`, by reason)."""

    def __init__(self, begin: Begin, need_image: bool) -> None:
        self._begin, self._need_image = begin, need_image
        self._number = -1
        self.work: Work | None = None
        self._skipped: list[Picture] = []  # before the first that could be decoded; the stabiliser counts them too
        self.undecoded: Counter[str] = Counter()

    def step(self, picture: Picture) -> PlacedPicture | None:
        """Places the next picture; None: it cannot be decoded.

        Raises:
            InputError: the settings, the camera and the first frame contradict each other.
            WorkError: a GeoTIFF cannot be written.
        """
        self._number += 1
        frame = picture.decoded
        if self.work is not None or not isinstance(frame, MessageError):
            return self._worked(self._begun(frame), picture)
        self._skipped.append(picture)
        self.undecoded[str(frame)] += 1
        return None

    def _begun(self, frame: Decoded) -> Work:
        if self.work is None and isinstance(frame, Frame):
            self.work = self._begin(frame.size)
            for skipped in self._skipped:
                self.work.motion_of(skipped)
        assert self.work is not None
        return self.work

    def _worked(self, work: Work, picture: Picture) -> PlacedPicture | None:
        motion, frame = work.motion_of(picture), picture.decoded
        if isinstance(frame, MessageError):
            self.undecoded[str(frame)] += 1
            return None
        answer = work.engine.frame(frame, motion)
        if work.geotiffs is not None:
            work.geotiffs.take(answer)
        image = self._message(work.engine, answer) if self._need_image else None
        return PlacedPicture(self._number, work, picture, motion, answer, image)

    def finish(self) -> int:
        """Writes what is left to write; the number of GeoTIFFs in all."""
        geotiffs = None if self.work is None else self.work.geotiffs
        if geotiffs is None:
            return 0
        geotiffs.finish()
        return geotiffs.written

    def _message(self, engine: Georeferencer, answer: Georeferenced) -> bytes | None:
        message = OutgoingImage(answer.frame.warped_encoding, header_of(answer.frame))
        image = engine.orthophoto(answer, message.allocate)
        return None if image is None else message.cdr(image)
