"""When the images of a folder were taken, against their order and the frame rate that their stamps assume."""

from __future__ import annotations

import itertools
from typing import NamedTuple

from stab_ros.io.image_metadata import CaptureTime

_SECOND_NS = 10**9
_TOLERANCE = 0.05  # of the time between the first and the last image
_PAUSE_NS, _PAUSE_STEPS = 10 * _SECOND_NS, 10  # a longer step, also of so many usual ones, parts two recordings


class _Taken(NamedTuple):
    """An image by its number in the folder, its name and when it was taken."""

    number: int
    name: str
    when: CaptureTime


class CaptureTimes:
    """Collects the capture times of images."""

    def __init__(self) -> None:
        self._taken: dict[int, _Taken] = {}

    def add(self, number: int, name: str, when: CaptureTime | None) -> None:
        """The image of this number; None: it does not say when it was taken."""
        if when is not None:
            self._taken[number] = _Taken(number, name, when)

    def remark(self, fps: float) -> str:
        """How the times contradict the order of the images or `fps`; an empty string: they do not."""
        taken = [one for _, one in sorted(self._taken.items())]
        if len(taken) < 2:
            return ""
        return _disorder(taken) or _pause(taken) or _other_rate(taken, fps)


def _step_ns(pair: tuple[_Taken, _Taken]) -> int:
    return pair[1].when.time_ns - pair[0].when.time_ns


def _disorder(taken: list[_Taken]) -> str:
    back = [pair for pair in itertools.pairwise(taken) if _step_ns(pair) < 0]
    if not back:
        return ""
    before, after = back[0]
    return (f"{after.name} comes after {before.name} but was taken {-_step_ns(back[0]) / 1e9:g} s before it, by its "
            "EXIF time; frames are in the order of the names, rename the images if the times are right")


def _pause(taken: list[_Taken]) -> str:
    steps = [pair for pair in itertools.pairwise(taken) if pair[1].number - pair[0].number == 1]
    longest = max(steps, key=_step_ns, default=None)
    if longest is None or len(steps) < 2:
        return ""
    usual_ns = (sum(map(_step_ns, steps)) - _step_ns(longest)) / (len(steps) - 1)
    if _step_ns(longest) <= max(_PAUSE_NS, _PAUSE_STEPS * usual_ns):
        return ""
    return (f"{longest[1].name} was taken {_step_ns(longest) / 1e9:g} s after {longest[0].name}, by its EXIF time, the "
            f"others {usual_ns / 1e9:.3g} s after each other; the folder should hold one recording")


def _other_rate(taken: list[_Taken], fps: float) -> str:
    first, last = taken[0], taken[-1]
    frames, took_ns = last.number - first.number, _step_ns((first, last))
    assumed_ns = frames * 1e9 / fps
    resolution_ns = max(first.when.resolution_ns, last.when.resolution_ns)
    if not took_ns or abs(took_ns - assumed_ns) <= resolution_ns + _TOLERANCE * max(took_ns, assumed_ns):
        return ""
    rate = f"{frames * 1e9 / took_ns:.4g}"
    return f"the images were taken at {rate} frames/s, by their EXIF times, and not at {fps:g}: give --fps {rate}"
