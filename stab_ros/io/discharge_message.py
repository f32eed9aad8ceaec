"""The message on `discharge`: the discharge of the last seconds with its uncertainty, or why there is none."""

from __future__ import annotations

import math

import numpy as np

from stab_ros.core.text import number
from stab_ros.discharge.result import Discharge
from stab_ros.discharge.running import Reading
from stab_ros.io.cdr import Header
from stab_ros.io.diagnostics_message import OK, WARN, status_cdr

_SOURCES = ("alpha", "water level", "bed", "vectors", "shared", "filling", "verticals")
_FIGURES = ("q_m3_s", "sigma_m3_s", "low_m3_s", "high_m3_s", "measured_width_share", "wse_m", "area_m2", "width_m",
            "mean_m_s", "iso_sigma", "ive_sigma", "search_m")
_SHARES = ("measured", "interpolated", "extrapolated")
_COUNTS = ("vectors", "verticals", "verticals_measured", "start_ns", "end_ns")
_KEYS = (*_FIGURES, *(f"{name}_share" for name in _SHARES), *(f"sigma_{name.replace(' ', '_')}_m3_s"
                                                              for name in _SOURCES), *_COUNTS)


def discharge_cdr(reading: Reading, header: Header) -> bytes:
    """DiagnosticArray with one status: its message is `discharge_text`, its values are `discharge_values`."""
    level = WARN if reading.discharge is None or reading.warnings else OK
    message = "; ".join([discharge_text(reading), *reading.warnings])
    return status_cdr(header, "discharge", header.frame_id, level, message, discharge_values(reading))


def discharge_text(reading: Reading) -> str:
    """The discharge with its interval and its shares in a line, or why there is none."""
    found = reading.discharge
    if found is None:
        return f"no discharge: {reading.reason}"
    shares = found.shares
    return (f"{found.q_m3_s:.4g} m3/s, with 95 % between {found.low_m3_s:.4g} and {found.high_m3_s:.4g}, measured "
            f"{shares.measured:.0%}, interpolated {shares.interpolated:.0%}, extrapolated {shares.extrapolated:.0%}, "
            f"vectors over {found.measured_width_share:.0%} of the width")


def discharge_values(reading: Reading) -> dict[str, str]:
    """Figures by name, in full precision, those of `stab-ros discharge --json`; empty where there is none."""
    values = dict.fromkeys(_KEYS, "") if reading.discharge is None else _values(reading.discharge)
    return {**values, "reason": reading.reason, "warnings": "; ".join(reading.warnings)}


def _values(found: Discharge) -> dict[str, str]:
    table = found.verticals
    counts = (found.vectors, int(table.wet.sum()), int(np.sum(table.measured)), found.start_ns, found.end_ns)
    numbers = (*(getattr(found, name) for name in _FIGURES), *(getattr(found.shares, name) for name in _SHARES),
               *(found.sources_m3_s[name] for name in _SOURCES))
    texts = (*(number(value) if math.isfinite(value) else "" for value in numbers), *map(str, counts))
    return dict(zip(_KEYS, texts, strict=True))
