"""Values that a file repeats until the sensor has a new one: a fix at 10 Hz in the subtitles of each frame."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Hashable, Sequence


def measured(values: Sequence[Hashable]) -> list[int]:
    """The places of those values that were measured, not repeated.

    The first of each run of equal values was. A run that is longer than usual holds further ones, as the sensor stood
    still: one in as many places as the usual run is long, so that a value that stays is not taken for one that slowly
    becomes the next.
    """
    runs = [len(list(run)) for _, run in itertools.groupby(values)]
    period = _usual(runs[1:-1])
    starts = itertools.accumulate(runs, initial=0)
    return [place for start, length in zip(starts, runs, strict=False)
            for place in range(start, start + length, period)]


def _usual(runs: Sequence[int]) -> int:
    """The most frequent length; one more where that is nearly as frequent: 2.5 frames a fix are runs of 2 and 3."""
    counts = Counter(runs)
    if not counts:
        return 1
    length = min(counts, key=lambda length: (-counts[length], length))
    return length + 1 if counts[length + 1] * 2 >= counts[length] else length
