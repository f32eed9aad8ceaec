"""The messages of a coded video as pictures: each with its own stamp, the lost ones in between.

A decoder may hold pictures back, or give several at once; where a video has B-frames, packets come in another order
than pictures. Pictures are given in the order in which they are shown; messages, with their log times, in the order in
which they came. Where the stamps of packets go on steadily although their pictures are reordered, they are those of
packets, so that they belong to the pictures in the order in which these are shown, too.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

from stab_ros.core.errors import MessageError
from stab_ros.core.text import one_line
from stab_ros.core.types import Frame
from stab_ros.io.bag_types import Message
from stab_ros.io.coded_message import CodedImage
from stab_ros.io.frame_reader import Decoded
from stab_ros.io.picture import Picture
from stab_ros.io.video_decoder import MAX_DELAY, Shown, VideoDecoder, decoder_of

_NO_KEY_FRAME = "no key frame has come before it, with which decoding can start"
_AFTER_DAMAGE = "it builds on a packet that is damaged or missing; decoding starts again with the next key frame"
_NO_PICTURE = "the decoder has given no picture for it"


class _Waiting(NamedTuple):
    """A message whose picture has not come out yet."""

    message: Message
    stamp_ns: int
    frame_id: str = ""


class VideoPictures:
    """One picture for each message. After a damaged packet, pictures are lost up to the next key frame."""

    def __init__(self) -> None:
        self._decoder: VideoDecoder | None = None
        self._format = ""
        self._waiting: dict[int, _Waiting] = {}  # by number, in the order of arrival
        self._arrived: deque[_Waiting] = deque()  # as many, those that came first
        self._newest = -1
        self._newest_ns = self._shown_ns = 0  # stamps of packets and of the last picture
        self._of_pictures = False  # stamps have gone back: each is that of the packet's own picture
        self._why = _NO_KEY_FRAME  # a picture that does not come out is lost

    def take(self, message: Message, packet: CodedImage) -> Iterator[Picture]:
        """The pictures that are known once the next packet has come."""
        if decoder_of(packet.format) != decoder_of(self._format):
            yield from self.finish()
            self._decoder = None
        self._format = one_line(packet.format[:40])
        one = _Waiting(message, packet.header.stamp_ns, packet.header.frame_id)
        self._follow(one.stamp_ns)
        try:
            self._decoder = self._decoder or VideoDecoder(packet.format)
        except MessageError as error:
            yield self._picture(self._wait(one), error)
            return
        if self._decoder.misses_before(packet.data):
            yield from self._drained()
            self._why = _AFTER_DAMAGE if self._why == _NO_PICTURE else self._why
        number = self._wait(one)
        try:
            shown = self._decoder.decode(number, packet.data)
        except MessageError as error:
            yield from self._resume(number, str(error), self._decoder.finish())
            return
        yield from self._given(shown)
        yield from self._lost(waiting for waiting in self._waiting if number - waiting > MAX_DELAY)

    def skip(self, message: Message, stamp_ns: int, error: MessageError) -> Iterator[Picture]:
        """The pictures that are known once a message has come that cannot be read."""
        number = self._wait(_Waiting(message, stamp_ns))
        if self._decoder is None:
            yield self._picture(number, error)
        else:
            yield from self._resume(number, str(error), self._decoder.finish(), is_read=False)

    def finish(self) -> Iterator[Picture]:
        """The pictures that were held back, and the last ones lost."""
        yield from self._drained()
        self._why = _NO_KEY_FRAME

    def _drained(self) -> Iterator[Picture]:
        """Nothing waits afterwards, and decoding starts anew."""
        if self._decoder is not None:
            yield from self._given(self._decoder.finish())
        yield from self._lost(self._waiting)

    def _wait(self, one: _Waiting) -> int:
        self._newest += 1
        self._waiting[self._newest] = one
        self._arrived.append(one)
        return self._newest

    def _follow(self, stamp_ns: int) -> None:
        """Whether stamps are those of pictures. A picture comes after all that are shown: else a clock was set back."""
        if 0 < stamp_ns <= self._shown_ns:
            self._newest_ns = stamp_ns
        self._of_pictures = self._of_pictures or 0 < stamp_ns < self._newest_ns
        self._newest_ns = max(self._newest_ns, stamp_ns)

    def _judge_anew(self) -> None:
        """From a key frame on: a clock that was set back by no more than the decoder holds looks like reordering."""
        self._newest_ns, self._of_pictures = 0, False
        for waiting in self._waiting.values():
            self._follow(waiting.stamp_ns)

    def _given(self, shown: Sequence[Shown]) -> Iterator[Picture]:
        """Decoded pictures, and before each the ones that are lost, as one after them is shown already."""
        for place, one in enumerate(shown):
            if one.number not in self._waiting:  # a second picture in one packet
                continue
            yield from self._lost(waiting for waiting in self._waiting if self._is_past(waiting, one))
            if not one.sound:
                assert self._decoder is not None
                held = [*shown[place + 1 :], *self._decoder.finish()]
                yield from self._resume(one.number, "the packet is damaged", held)
                return
            self._why = _NO_PICTURE
            self._shown_ns = self._stamp_ns(one.number)
            yield self._picture(one.number, self._frame(one))
            if one.key:
                self._judge_anew()

    def _is_past(self, waiting: int, shown: Shown) -> bool:
        """Whether a picture that waits can no longer come, as a later packet's is shown."""
        assert self._decoder is not None
        late = shown.key or not self._decoder.reorders or shown.number - waiting > MAX_DELAY
        return waiting < shown.number and late

    def _resume(self, damaged: int, why: str, held: Sequence[Shown], is_read: bool = True) -> Iterator[Picture]:
        """Gives the pictures that were held back and do not build on the damage; decoding starts anew after it."""
        yield from self._given([one for one in held if one.number < damaged])
        yield from self._lost(waiting for waiting in self._waiting if waiting < damaged)
        began = self._why == _NO_PICTURE
        if damaged in self._waiting:  # else a picture before it is damaged too
            yield self._picture(damaged, MessageError(why if began or not is_read else self._why))
        self._why = _AFTER_DAMAGE if began else self._why
        yield from self._lost(self._waiting)

    def _lost(self, numbers: Iterable[int]) -> Iterator[Picture]:
        for number in list(numbers):
            yield self._picture(number, MessageError(self._why))

    def _frame(self, shown: Shown) -> Decoded:
        try:
            return Frame(*shown.image(), self._stamp_ns(shown.number), self._waiting[shown.number].frame_id)
        except MessageError as error:
            return error

    def _picture(self, number: int, decoded: Decoded) -> Picture:
        stamp_ns = self._stamp_ns(number)
        del self._waiting[number]
        message = self._arrived.popleft().message
        if isinstance(decoded, MessageError) and self._format:
            decoded = MessageError(f"{self._format} video: {decoded}")
        return Picture(message.log_time_ns, message.publish_time_ns, stamp_ns, decoded, message.data)

    def _stamp_ns(self, number: int) -> int:
        return (self._waiting[number] if self._of_pictures else self._arrived[0]).stamp_ns
