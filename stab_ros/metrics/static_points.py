"""Which verification points move on their own: one picture cannot tell water from bank, a few can."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stab_ros.core.types import BoolArray, FloatArray, IdArray

_TOLERANCE_PX, _OF_MOTION = 0.5, 0.05  # off the motion of the others, by which a point has moved
_LEAST_POINTS = 4  # two always agree on a motion
_MOST_SAMPLES = 300
_LEAST_VOTES, _SHARE = 2, 0.25  # of the frames, from which on a point does not count as static; the first counts alone


class StaticPoints:
    """Votes, frame by frame, on P points.

    However badly a picture is held, ground moves as one: its shifts against the reference are those of one similarity,
    the one that most points agree on (a shear, as between bank and water, no camera makes). What is off it, or is not
    found again, moves on its own.
    """

    def __init__(self, centres_px: IdArray) -> None:
        """centres_px: (P, 2)."""
        self._places = _complex(centres_px)
        self._seen = np.zeros(len(centres_px), np.int64)
        self._moved = np.zeros(len(centres_px), np.int64)

    @property
    def static(self) -> BoolArray:
        """(P,) bool: those that moved in less than a quarter of the frames, or only once of several."""
        least = np.minimum(_LEAST_VOTES, np.maximum(self._seen, 1))
        return np.asarray((self._moved < least) | (self._moved < _SHARE * self._seen))

    def vote(self, shifts_px: FloatArray, usable: BoolArray) -> None:
        """One frame. shifts_px: (P, 2), NaN where the look was not found again; usable: (P,), where it could be."""
        found = usable & np.isfinite(shifts_px).all(axis=1)
        if found.sum() < max(_LEAST_POINTS, usable.sum() / 2):
            return
        shifts = _complex(shifts_px[found])
        tolerance_px = _TOLERANCE_PX + _OF_MOTION * float(np.median(np.abs(shifts)))
        off_px = np.full(len(found), np.inf)
        off_px[found] = _off_the_others_px(self._places[found], shifts, tolerance_px)
        self._seen += usable
        self._moved += usable & (off_px > tolerance_px)


def _complex(points: FloatArray | IdArray) -> NDArray[np.complex128]:
    return np.asarray(points[:, 0] + 1j * points[:, 1])


def _off_the_others_px(places: NDArray[np.complex128], shifts: NDArray[np.complex128],
                       tolerance_px: float) -> FloatArray:
    """(n,): distance of each shift from the similarity through two points that leaves the least, robustly (MSAC)."""
    one, other = _pairs(len(places))
    turn = (shifts[one] - shifts[other]) / (places[one] - places[other])
    off_px = np.abs(shifts[one, None] + turn[:, None] * (places - places[one, None]) - shifts)
    return np.asarray(off_px[np.minimum(off_px**2, tolerance_px**2).sum(axis=1).argmin()])


def _pairs(count: int) -> tuple[IdArray, IdArray]:
    """All of them, or an even selection where there are many."""
    one, other = np.triu_indices(count, 1)
    every = -(-len(one) // _MOST_SAMPLES)
    return one[::every], other[::every]
