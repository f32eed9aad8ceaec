"""Trajectories as GeoJSON: a line from start to end for every vector.

Where the map is on the Earth is known, coordinates are those of WGS 84 (RFC 7946); else they are metres in the map, or
pixels of the reference, which `coordinates` says.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from stab_ros.core.errors import WorkError
from stab_ros.core.types import FloatArray
from stab_ros.georeferencing.local_frame import LocalFrame
from stab_ros.velocimetry.speeds import sigma_speed_m_s, speed_m_s
from stab_ros.velocimetry.vectors import Vectors


def write_tracks(path: Path, vectors: Vectors, wse_m: float = 0.0, local_frame: LocalFrame | None = None) -> None:
    """Writes a FeatureCollection of LineStrings, with velocity, its sigma, stamps and track_id as properties.

    Args:
        path: the file; an existing one is overwritten.
        vectors: in metres of the map, or pixels.
        wse_m: water surface elevation in the map.
        local_frame: where the map is on the Earth; None: unknown.

    Raises:
        WorkError: the file cannot be written.
    """
    placed = local_frame if vectors.unit == "m" else None
    kind = "WGS 84" if placed is not None else {
        "m": "metres in the map, east and north", "px": "pixels of the reference"}[vectors.unit]
    try:
        with path.open("w", encoding="utf-8") as file:
            file.write(f'{{"type": "FeatureCollection", "coordinates": "{kind}", "features": [')
            for number, feature in enumerate(_features(vectors, wse_m, placed)):
                file.write((",\n" if number else "\n") + json.dumps(feature, allow_nan=False))
            file.write("\n]}\n")
    except OSError as error:
        raise WorkError(f"{path}: {error.strerror}") from error


def _features(vectors: Vectors, wse_m: float, local_frame: LocalFrame | None) -> Iterator[dict[str, Any]]:
    lines = np.stack([_coordinates(end, wse_m, local_frame) for end in (vectors.start_m, vectors.end_m)], axis=1)
    real = np.column_stack([vectors.velocity_m_s, speed_m_s(vectors), sigma_speed_m_s(vectors), vectors.dt_s])
    whole = np.column_stack([vectors.start_ns, vectors.end_ns, vectors.track_id])
    u = vectors.unit
    names = (f"vx_{u}_s", f"vy_{u}_s", f"speed_{u}_s", f"sigma_speed_{u}_s", "dt_s", "start_ns", "end_ns", "track_id")
    for line, numbers, counts in zip(lines.tolist(), real.tolist(), whole.tolist(), strict=True):
        yield {"type": "Feature", "geometry": {"type": "LineString", "coordinates": line},
               "properties": dict(zip(names, [*numbers, *counts], strict=True))}


def _coordinates(places: FloatArray, wse_m: float, local_frame: LocalFrame | None) -> FloatArray:
    """(N, 2), x and y, or longitude and latitude in degrees."""
    if local_frame is None or not len(places):
        return places
    geodetic = local_frame.to_geodetic(np.column_stack([places, np.full(len(places), wse_m)]))
    return np.asarray(geodetic[:, [1, 0]])
