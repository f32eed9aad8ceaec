"""Pictures that are exact copies of the one before, as a file has where its rate is not that of the camera."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from stab_ros.core.text import are, counted
from stab_ros.core.types import Frame, Image
from stab_ros.io.bag import Message
from stab_ros.io.picture import Picture

_ROW_STEP = 64  # of the rows that are compared first: two pictures of a camera differ there
_LEAST_COPIES, _LEAST_SHARE = 2, 0.01


class RepeatedPictures:
    """Counts the copies in a stream.

    Attributes:
        pictures: number of pictures so far.
        copies: of these that equal the one before; flat ones, as of a covered lens, are no copies.
    """

    def __init__(self) -> None:
        self.pictures = self.copies = 0
        self._last: Image | None = None

    def watched(self, items: Iterable[Picture | Message]) -> Iterator[Picture | Message]:
        """The items as they come."""
        for item in items:
            if isinstance(item, Picture) and isinstance(item.decoded, Frame):
                self.add(item.decoded.image)
            yield item
        self._last = None

    def add(self, image: Image) -> None:
        """Takes the next picture."""
        self.pictures += 1
        self.copies += self._last is not None and _equal(image, self._last)
        self._last = image

    def remark(self) -> str:
        """What the copies do to the stamps, in one line; empty where there are none to speak of."""
        if self.copies < max(_LEAST_COPIES, _LEAST_SHARE * self.pictures):
            return ""
        return (f"{self.copies} of {counted(self.pictures, 'image')} ({self.copies / self.pictures:.0%}) "
                f"{are(self.copies)} exact copies of the one before, with stamps of their own: the camera took fewer, "
                "at other times, so stamps are off by up to the time between images, and speeds over few images with "
                "them")


def _equal(one: Image, other: Image) -> bool:
    alike = np.array_equal(one[::_ROW_STEP], other[::_ROW_STEP]) and np.array_equal(one, other)
    return alike and bool((one != one[:1, :1]).any())
