"""Ground control points as GeoJSON: points with their pixels among the properties."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path
from typing import Any

import numpy as np

from stab_ros.core.errors import InputError
from stab_ros.core.text import one_line
from stab_ros.io.gcp_file_table import MOST_POINTS, GcpTable, meaning

_CRS = re.compile(r"EPSG:(?:[\d.]*:)?(\d+)$", re.IGNORECASE)


def of_geojson(path: Path, text: str) -> GcpTable:
    """The control points of a FeatureCollection.

    Args:
        path: for messages.
        text: its content.

    Raises:
        InputError: as `read_gcps`.
    """
    try:
        document = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: is no GeoJSON ({one_line(error)[:120]})") from error
    features = document.get("features") if isinstance(document, dict) else None
    if not isinstance(features, list) or not features or len(features) > MOST_POINTS:
        raise InputError(f"{path}: is no GeoJSON of control points, it must be a FeatureCollection of Points with x and"
                         " y (pixels) among their properties")
    points = [_feature(path, number, feature) for number, feature in enumerate(features, 1)]
    crs = _crs_of(path, document)
    return GcpTable(tuple(name for name, _, _ in points), np.array([px for _, px, _ in points]),
                    np.array([place for _, _, place in points]), crs is None, crs)


def _feature(path: Path, number: int, feature: Any) -> tuple[str, tuple[float, float], tuple[float, ...]]:
    geometry = feature.get("geometry") if isinstance(feature, dict) else None
    properties = feature.get("properties") if isinstance(feature, dict) else None
    place = geometry.get("coordinates") if isinstance(geometry, dict) and geometry.get("type") == "Point" else None
    if not isinstance(properties, dict) or not isinstance(place, list) or len(place) not in (2, 3):
        raise InputError(f"{path}: feature {number} is no control point, it must be a Point with x and y (pixels) "
                         "among its properties")
    found = {meaning(str(key)): value for key, value in properties.items()}
    values = [*(found.get(what) for what in ("px", "py")), *place]
    if not all(isinstance(value, (int, float)) and abs(value) < 1e300 for value in values):
        raise InputError(f"{path}: feature {number} must have the numbers x and y (pixels) among its properties, and "
                         "coordinates")
    px, py, *where = (float(value) for value in values if isinstance(value, (int, float)))
    name = found.get("name")
    return str(name) if name not in (None, "") else f"G{number}", (px, py), (*where, *[math.nan] * (3 - len(where)))


def _crs_of(path: Path, document: dict[str, Any]) -> str | None:
    """The reference system that a GeoJSON of before 2016 may name; WGS 84 else."""
    crs = document.get("crs")
    properties = crs.get("properties") if isinstance(crs, dict) else None
    name = properties.get("name") if isinstance(properties, dict) else None
    if name is None or "CRS84" in str(name):
        return None
    found = _CRS.search(str(name))
    if found is None:
        raise InputError(f"{path}: a reference system {one_line(name)[:80]!r}, it must be an EPSG code")
    return f"EPSG:{found[1]}"
