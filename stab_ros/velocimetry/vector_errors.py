"""From tracks to velocity vectors with their covariance.

What each vector has by itself (`Vectors.covariance`) is the error of its place in the last image relative to the first.
The columns of `Vectors.shared` are, in this order:

| columns | error |
|---|---|
| 0 to 7 | homography of the first frame, by itself |
| 8 to 15 | homography of the last frame, by itself |
| 16 | stamps of both frames |
| from 17 on | those of `PlacedFrame.shared`, one each: the difference of what they do at the end and at the start |

Errors of one frame are common to all vectors of an interval, so they do not average out over them. Another interval has
other frames in the columns 0 to 16; columns 0 to 7 of a vector that begins with a frame and 8 to 15 of one that ends
with it are the same eight errors, for both are derivatives by `factor` of its one covariance. Vectors that ended
before the interval did share columns 8 to 15 with the others, which overstates what they have in common.
"""

from __future__ import annotations

import numpy as np

from stab_ros.core.covariance import factor
from stab_ros.core.types import BoolArray, FloatArray, IdArray
from stab_ros.velocimetry.placed_frame import PlacedFrame
from stab_ros.velocimetry.places import place_derivatives
from stab_ros.velocimetry.tracks import Tracks
from stab_ros.velocimetry.vectors import Unit, Vectors

START_COLUMNS, END_COLUMNS, TIME_COLUMN, PERSISTENT_COLUMNS = slice(0, 8), slice(8, 16), 16, slice(17, None)


def vectors_of(tracks: Tracks, keep: BoolArray, first_id: int, time_sigma_s: float, unit: Unit) -> Vectors:
    """The vectors of tracks, from the first to the last position of each.

    Args:
        tracks: of an interval, finished.
        keep: (N,) bool, those that become vectors; they were seen in a frame after the first.
        first_id: of the first feature of the tracks.
        time_sigma_s: standard deviation of a stamp.
        unit: of lengths.
    """
    which = np.flatnonzero(keep)
    stamps_ns, places_m = tracks.stamps_ns, np.stack(tracks.places_m)
    ends = tracks.end_frame[which]
    start_m, end_m = places_m[0, which], places_m[ends, which]
    start_ns, end_ns = np.full(len(which), stamps_ns[0]), stamps_ns[ends]
    dt_s = ((end_ns - start_ns) * 1e-9)[:, None, None]
    in_time = -(end_m - start_m)[:, :, None] * np.sqrt(2) * time_sigma_s / dt_s
    shared = np.concatenate([*_by_homographies(tracks, which), in_time, _by_persistent(tracks, which)], axis=2) / dt_s
    return Vectors(start_m, end_m, start_ns, end_ns, tracks.covariance_m2[which] / dt_s**2, shared, first_id + which,
                   unit)


def _by_homographies(tracks: Tracks, which: IdArray) -> tuple[FloatArray, FloatArray]:
    """Changes (n, 2, 8) of the displacement by errors of the first homography, and of the last one of each."""
    first = tracks.frames[0]
    _, at_start = place_derivatives(first, tracks.start_px[which])
    at_end = np.zeros((len(which), 2, 8))
    for frame, these in _by_end(tracks, which):
        at_end[these] = place_derivatives(frame, tracks.end_px[which[these]])[1] @ factor(frame.covariance)
    return -at_start @ factor(first.covariance), at_end


def _by_persistent(tracks: Tracks, which: IdArray) -> FloatArray:
    """Changes (n, 2, K) of the displacement by the errors that all frames share."""
    first = tracks.frames[0]
    change = -place_derivatives(first, tracks.start_px[which])[1] @ first.shared
    for frame, these in _by_end(tracks, which):
        change[these] += place_derivatives(frame, tracks.end_px[which[these]])[1] @ frame.shared
    return np.asarray(change)


def _by_end(tracks: Tracks, which: IdArray) -> list[tuple[PlacedFrame, IdArray]]:
    """The last frames of the tracks `which`, (n,), and the indices into `which` of those that end there."""
    ends = tracks.end_frame[which]
    return [(tracks.frames[end], np.flatnonzero(ends == end)) for end in np.unique(ends)]
