"""The engine of velocimetry: a placed frame in, the vectors of each interval out; the same live and offline."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from stab_ros.core.geometry import apply
from stab_ros.core.types import BoolArray, FloatArray, Frame, Homography, IdArray
from stab_ros.georeferencing.georeferencer import Georeferenced
from stab_ros.georeferencing.placement import Motion, Placement
from stab_ros.velocimetry.method import Method
from stab_ros.velocimetry.pictures import Pictures, Stream
from stab_ros.velocimetry.placed_frame import PlacedFrame
from stab_ros.velocimetry.placing import epoch_of, placed_frame, plane_H_ref
from stab_ros.velocimetry.vectors import Vectors
from stab_ros.velocimetry.zone import Zone

# where velocities are wanted, (h, w) bool; None: everywhere. In a reference of this width and height; and whether it is
# the first of the stream, for which maps were made
Allowed = Callable[[tuple[int, int], bool], BoolArray | None]
# a method that has seen no frame yet
MakeMethod = Callable[[Zone], Method]
_EDGE_PX = 24  # width of the border of a frame that its orthophoto is not used of: windows there lie half outside


@dataclass(frozen=True, eq=False)
class Measured:
    """The vectors of one interval.

    Attributes:
        frame: that ended it, or after which no frame of it came.
        placed: that frame, as the method took it.
        stamp_ns: of its last frame.
        vectors: where velocities are wanted; they may be none.
        wse_m: water surface elevation at that frame.
        zone: of the reference.
        dropped: how many vectors were dropped, by reason, wherever they lay.
        scale_wse_m: water surface elevation whose scale they have; NaN: they have that of none.
        doubts: what is doubtful, in words, by kind.
    """

    frame: Frame
    placed: PlacedFrame
    stamp_ns: int
    vectors: Vectors
    wse_m: float
    zone: Zone
    dropped: Mapping[str, int] = field(default_factory=dict)
    scale_wse_m: float = math.nan
    doubts: Mapping[str, str] = field(default_factory=dict)


class Velocimeter:
    """Measures the velocities of a stream of frames that georeferencing has placed.

    Frames that are lost or unplaced are left out: a track leads over them where the method allows the gap. Where stamps
    go back or a new reference begins, the interval ends.
    """

    def __init__(self, stream: Stream, make_method: MakeMethod, allowed: Allowed) -> None:
        """Prepares for a stream.

        Args:
            stream: what is known of its frames.
            make_method: for each reference anew.
            allowed: where velocities are wanted.
        """
        self._stream, self._make_method, self._allowed = stream, make_method, allowed
        self._pictures = Pictures(stream)
        self._first_epoch: int | None = None
        self._with_error: bool | None = None  # whether the errors of places are known
        self._last: tuple[Georeferenced, PlacedFrame] | None = None
        self._method: Method | None = None
        self._zone: Zone | None = None
        self._whole: dict[int, tuple[Homography, tuple[int, int]]] = {}  # of orthophotos: cur_H_plane, size, by stamp

    def add(self, answer: Georeferenced, motion: Motion | None) -> list[Measured]:
        """Takes the next frame.

        Args:
            answer: where it lies.
            motion: how it lies to the reference; None: lost, or not stabilised.

        Returns:
            The interval that ends with it, and one that ended before it.

        Raises:
            InputError: a region does not fit the reference.
        """
        placement, unit = self._usable(answer, motion), self._stream.unit
        if placement is None:
            return []
        ended = [] if self._follows(answer, motion) else self._end()
        if self._method is None or self._zone is None:
            size = self._stream.reference_size or answer.frame.size
            self._zone = Zone(plane_H_ref(placement, motion, unit), self._allowed(size, self._is_first(motion)))
            self._method = self._make_method(self._zone)
        picture, stamp_ns = self._pictures.of(answer, motion), answer.frame.stamp_ns
        placed = placed_frame(stamp_ns, placement, picture, motion, unit)
        self._last = (answer, placed)
        if self._stream.orthophoto is not None:
            self._whole[stamp_ns] = (picture.cur_H_picture @ np.linalg.inv(placed.plane_H_image), answer.frame.size)
        return [*ended, *self._measured(self._method.add(placed))]

    def finish(self) -> list[Measured]:
        """The interval that was under way when the stream ended."""
        return [] if self._method is None else self._measured(self._method.finish())

    def _is_first(self, motion: Motion | None) -> bool:
        """Whether this is the first reference of the stream."""
        if self._first_epoch is None:
            self._first_epoch = epoch_of(motion)
        return self._first_epoch == epoch_of(motion)

    def _usable(self, answer: Georeferenced, motion: Motion | None) -> Placement | None:
        """The placement; None: there is none, or its error is unknown, unlike that of the first frame."""
        placement = answer.placement
        if placement is None or (motion is None and self._stream.image_H_ref is not None):
            return None
        if self._with_error is None:
            self._with_error = placement.error is not None
        if not self._with_error:
            return replace(placement, error=None)
        return None if placement.error is None else placement

    def _follows(self, answer: Georeferenced, motion: Motion | None) -> bool:
        return self._last is None or (self._last[0].frame.stamp_ns < answer.frame.stamp_ns
                                      and self._last[1].epoch == epoch_of(motion))

    def _end(self) -> list[Measured]:
        """Ends the interval; the next frame begins anew."""
        ended = self.finish()
        self._method = self._zone = None
        return ended

    def _measured(self, vectors: Vectors | None) -> list[Measured]:
        if vectors is None or self._last is None or self._zone is None or self._method is None:
            return []
        middle_m = vectors.position_m
        start_m, end_m = (vectors.start_m, vectors.end_m) if self._method.follows else (middle_m, middle_m)
        wanted = self._zone.holds_places(start_m) & self._zone.holds_places(end_m)
        if self._stream.orthophoto is not None:
            wanted &= self._inside(start_m, vectors.start_ns) & self._inside(end_m, vectors.end_ns)
            last_ns = self._last[0].frame.stamp_ns
            self._whole = {stamp_ns: one for stamp_ns, one in self._whole.items() if stamp_ns == last_ns}
        answer, placed = self._last
        stamp_ns = int(vectors.end_ns.max(initial=0)) or placed.stamp_ns
        return [Measured(answer.frame, placed, stamp_ns, vectors[wanted], answer.wse_m, self._zone,
                         self._method.dropped, self._scale_wse_m(answer), self._method.doubts)]

    def _scale_wse_m(self, answer: Georeferenced) -> float:
        """Where the scale is given, a level of 0 is that of the settings, which nobody told."""
        return answer.wse_m if self._stream.level_scales or answer.wse_m else math.nan

    def _inside(self, places: FloatArray, stamps_ns: IdArray) -> BoolArray:
        """(N,) bool: which places the frames as taken show, off their borders, which orthophotos show as edges."""
        inside = np.ones(len(places), bool)
        for stamp_ns in np.unique(stamps_ns).tolist():
            at, (cur_H_plane, size) = stamps_ns == stamp_ns, self._whole.get(stamp_ns, (None, (0, 0)))
            if cur_H_plane is not None:
                pixels = apply(cur_H_plane, places[at])
                inside[at] = ((pixels >= _EDGE_PX) & (pixels <= np.array(size) - 1 - _EDGE_PX)).all(axis=1)
        return inside
