"""The message on `track`: how each frame was tracked."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stab_ros.core.errors import MessageError
from stab_ros.core.text import number
from stab_ros.core.types import FloatArray, Homography, Track
from stab_ros.imaging.window import Window
from stab_ros.io.cdr import Header, read_stamp
from stab_ros.io.diagnostics_message import OK, WARN, read_values, status_cdr

_WHOLE = Window()


def track_cdr(track: Track, header: Header, window: Window = _WHOLE) -> bytes:
    """DiagnosticArray with one status for the frame; empty strings: unknown while LOST, lost_reason while TRACKED.

    `rows_px` is the RMS of the displacements of the rows by a rolling shutter, empty where none are seen.
    `simpler_model` is the one that took the place of `model`, empty where it did not. `reset_reason` tells why
    `reset_counter` rose last, empty before that.

    window: the part of the reference that `image_stabilized` shows.
    """
    values = {
        "state": track.state.value,
        "reference_stamp_ns": str(track.reference_stamp_ns),
        "reset_counter": str(track.reset_counter),
        "matches": str(track.matches),
        "inliers": str(track.inliers),
        "rmse_px": number(track.rmse_px),
        "sigma_px": number(track.sigma_px),
        "covariance": "" if track.covariance is None else _upper_triangle(track.covariance),
        "offset": " ".join(f"{offset_px:.12g}" for offset_px in window.offset),
        "scale": f"{window.scale:.12g}",
        "provisional": str(track.provisional).lower(),
        "rows_px": number(None if track.rows is None else track.rows.rms_px),
        "simpler_model": track.simpler_model,
        "lost_reason": "" if track.lost_reason is None else track.lost_reason.value,
        "reset_reason": "" if track.reset_reason is None else track.reset_reason.value,
    }
    level = OK if track.tracked else WARN
    return status_cdr(header, "track", header.frame_id, level, track.state.value, values)


def _upper_triangle(covariance: FloatArray) -> str:
    return " ".join(number(value) for value in covariance[np.triu_indices(len(covariance))])


@dataclass(frozen=True, eq=False)
class TrackValues:
    """What a `track` message tells beside the homography.

    Attributes:
        stamp_ns: of the frame.
        covariance: (8, 8) of h00 .. h21; None: lost, or unknown.
        reset_counter: how often the reference had been replaced.
        window_H_ref: (3, 3), from pixels of the reference to those of `image_stabilized`.
    """

    stamp_ns: int
    covariance: FloatArray | None
    reset_counter: int
    window_H_ref: Homography


def read_track(cdr: bytes | memoryview) -> TrackValues:
    """What is needed to use a homography elsewhere.

    Raises:
        MessageError: damaged, or its values are not those of a track.
    """
    values = read_values(cdr)
    try:
        x, y = _numbers(values["offset"], 2)
        (scale,) = _numbers(values["scale"], 1)
        covariance = _symmetric(_numbers(values["covariance"], 36)) if values["covariance"] else None
        counter = int(values["reset_counter"])
        if not scale > 0:
            raise ValueError(scale)
    except (KeyError, ValueError) as error:
        raise MessageError("track: offset, scale, covariance and reset_counter must be as the tracker writes them") \
            from error
    return TrackValues(read_stamp(cdr), covariance, counter,
                       np.array([[scale, 0, -scale * x], [0, scale, -scale * y], [0, 0, 1]]))


def _numbers(text: str, count: int) -> FloatArray:
    """Raises ValueError unless they are `count` finite numbers."""
    numbers = np.array([float(word) for word in text.split()])
    if len(numbers) != count or not np.isfinite(numbers).all():
        raise ValueError(text)
    return numbers


def _symmetric(upper: FloatArray) -> FloatArray:
    full = np.zeros((8, 8))
    full[np.triu_indices(8)] = upper
    return np.asarray(full + np.triu(full, 1).T)
