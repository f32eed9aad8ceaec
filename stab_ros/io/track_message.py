"""The message on `track`: how each frame was tracked."""

from __future__ import annotations

import numpy as np

from stab_ros.core.text import number
from stab_ros.core.types import FloatArray, Track
from stab_ros.imaging.window import Window
from stab_ros.io.cdr import Header
from stab_ros.io.diagnostics_message import OK, WARN, status_cdr

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
