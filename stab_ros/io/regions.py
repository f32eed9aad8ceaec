"""Reads `roi` and `exclude`: polygons as JSON text or in a .json file, or a PNG mask."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from stab_ros.core.errors import InputError, MessageError
from stab_ros.core.region import Area, Region
from stab_ros.core.settings import Value
from stab_ros.core.types import FloatArray
from stab_ros.io.compressed_image import MAX_DECODED, decode_file

_FORMS = "[[[x, y], ...], ...], [[x, y], ...] or [x, y, x, y, ...]"
_MAX_CORNERS = 2000  # of all polygons: whether sides cross is asked of every pair
_MAX_TEXT = 2**20  # characters


def read_area(values: Mapping[str, Value]) -> Area:
    """Reads the parameters `roi` and `exclude`.

    Args:
        values: parameters by name; each of the two is JSON, `[[[x, y], ...], ...]`, of one polygon `[[x, y], ...]` or
            `[x, y, x, y, ...]`, or the path of such a .json file or of a PNG mask.

    Returns:
        The area that they leave.

    Raises:
        InputError: a file is missing or no mask, the JSON is no list of polygons, or a polygon is invalid.
    """
    return Area(_region("roi", str(values.get("roi", ""))), _region("exclude", str(values.get("exclude", ""))))


def _region(name: str, text: str) -> Region | None:
    text = text.strip()
    if not text:
        return None
    if text.startswith("["):
        return _polygons(name, text, "the value")
    path = Path(text)
    if not _is_file(path):
        raise InputError(f"{name}: {text[:80]!r} is neither JSON [[[x, y], ...], ...] nor an existing .json or PNG")
    if path.suffix.lower() == ".json":
        return _polygons(name, _text(name, path), str(path))
    return _mask(name, path)


def _text(name: str, path: Path) -> str:
    try:
        with path.open(encoding="utf-8-sig", errors="replace") as file:
            return file.read(_MAX_TEXT + 1)
    except OSError as error:
        raise InputError(f"{name}: {path} cannot be read ({error.strerror}), it must be a .json of polygons") from error


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except (OSError, ValueError):  # no possible name of a file
        return False


def _polygons(name: str, text: str, where: str) -> Region:
    if len(text) > _MAX_TEXT:
        raise InputError(f"{name}: {where} has more than {_MAX_TEXT} characters, use a PNG mask for so fine a region")
    try:
        polygons = tuple(_corners(polygon) for polygon in _polygons_in(_list_of(text)))
    except (ValueError, TypeError, OverflowError, RecursionError) as error:
        raise InputError(f"{name}: {where} must be JSON {_FORMS} ({error})") from error
    if not polygons:
        raise InputError(f"{name}: {where} holds no polygon, it must hold at least one [[x, y], ...]")
    corners = sum(polygon.shape[0] for polygon in polygons if polygon.ndim)
    if corners > _MAX_CORNERS:
        raise InputError(f"{name}: {where} holds {corners} corners, it must hold at most {_MAX_CORNERS}; use a PNG "
                         "mask for so fine a region")
    return Region(name, polygons)


def _list_of(text: str) -> list[Any]:
    """Raises ValueError where the JSON is no list."""
    listed = json.loads(text)
    if not isinstance(listed, list):
        raise ValueError("it is an object, as GeoJSON is" if isinstance(listed, dict) else "it is no list")
    return listed


def _polygons_in(listed: list[Any]) -> list[Any]:
    """The polygons of a list of them, or the only one: of its corners, or of their x and y in turn."""
    if len(listed) == 2 and _are_numbers(listed):
        raise ValueError(f"of {listed} no polygon can be made: ROS keeps the last row of nested lists that are not "
                         "text, give them in quotes as \"'[[[x, y], ...], ...]'\"")
    of_one = listed and (_are_numbers(listed) or all(_are_numbers(one) and len(one) == 2 for one in listed))
    return [listed] if of_one else listed


def _are_numbers(listed: object) -> bool:
    return isinstance(listed, list) and all(isinstance(one, (int, float)) for one in listed)


def _corners(polygon: Any) -> FloatArray:
    """(n, 2) corners; other shapes are judged by `Region`."""
    corners = np.array(polygon, dtype=np.float64)
    if corners.ndim == 1 and corners.size % 2:
        raise ValueError(f"{corners.size} numbers are no pairs of x and y")
    return corners.reshape(-1, 2) if corners.ndim == 1 else corners


def _mask(name: str, path: Path) -> Region:
    try:
        colours = decode_file(np.fromfile(path, np.uint8, MAX_DECODED))  # not the alpha channel
    except (OSError, MessageError) as error:
        raise InputError(f"{name}: {path} cannot be read as a picture, it must be a PNG mask or a .json of polygons "
                         f"({error})") from error
    return Region(name, mask=np.asarray(colours.any(axis=2)))
