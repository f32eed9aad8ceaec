"""The work of georeferencing on every picture: its motion, its place, its orthophoto."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass

from stab_ros.core.errors import MessageError
from stab_ros.core.types import Frame
from stab_ros.georeferencing.georeferencer import Georeferenced, Georeferencer
from stab_ros.io.cdr import header_of
from stab_ros.io.outgoing_image import OutgoingImage
from stab_ros.io.source import Picture
from stab_ros.jobs.geotiffs import GeoTiffs
from stab_ros.jobs.motions import MotionOf

# makes the engine for images of this width and height, px, and what writes its GeoTIFFs, if any are wanted
Begin = Callable[[tuple[int, int]], tuple[Georeferencer, GeoTiffs | None]]


@dataclass(frozen=True, eq=False)
class PlacedPicture:
    """A picture with its answer, and its number in the input. image: the message of its orthophoto."""

    number: int
    picture: Picture
    answer: Georeferenced
    image: bytes | None


class PicturePlacer:
    """Runs the engine over all pictures; those that cannot be decoded have no answer (`undecoded`, by reason)."""

    def __init__(self, motion_of: MotionOf, begin: Begin, need_image: bool) -> None:
        self._motion_of, self._begin, self._need_image = motion_of, begin, need_image
        self._number = -1
        self.engine: Georeferencer | None = None
        self._geotiffs: GeoTiffs | None = None
        self.undecoded: Counter[str] = Counter()

    def step(self, picture: Picture) -> PlacedPicture | None:
        """Places the next picture; None: it cannot be decoded.

        Raises:
            InputError: the settings, the camera and the first frame contradict each other.
            WorkError: a GeoTIFF cannot be written.
        """
        self._number += 1
        motion, frame = self._motion_of(picture), picture.decoded
        if isinstance(frame, MessageError):
            self.undecoded[str(frame)] += 1
            return None
        engine = self._engine_of(frame)
        answer = engine.frame(frame, motion)
        if self._geotiffs is not None:
            self._geotiffs.take(answer)
        return PlacedPicture(self._number, picture, answer, self._message(engine, answer) if self._need_image else None)

    def finish(self) -> int:
        """Writes what is left to write; the number of GeoTIFFs in all."""
        if self._geotiffs is None:
            return 0
        self._geotiffs.finish()
        return self._geotiffs.written

    def _engine_of(self, frame: Frame) -> Georeferencer:
        if self.engine is None:
            self.engine, self._geotiffs = self._begin(frame.size)
        return self.engine

    def _message(self, engine: Georeferencer, answer: Georeferenced) -> bytes | None:
        message = OutgoingImage(answer.frame.warped_encoding, header_of(answer.frame))
        image = engine.orthophoto(answer, message.allocate)
        return None if image is None else message.cdr(image)
