"""Reads `roi` and `exclude`: JSON text, a .json file of polygons, or a PNG mask."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

import cv2
import numpy as np

from stab_ros.core.config import Value
from stab_ros.core.errors import InputError
from stab_ros.core.region import Area, Region


def read_area(values: Mapping[str, Value]) -> Area:
    """The area that the parameters `roi` and `exclude` leave.

    Raises:
        InputError: a file that is missing or no mask, JSON that is no list of polygons, or a bad polygon.
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
        return _polygons(name, path.read_text(encoding="utf-8", errors="replace"), str(path))
    return _mask(name, path)


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except (OSError, ValueError):  # no possible name of a file
        return False


def _polygons(name: str, text: str, where: str) -> Region:
    try:
        polygons = tuple(np.array(polygon, dtype=np.float64) for polygon in json.loads(text))
    except (ValueError, TypeError, OverflowError, RecursionError) as error:
        raise InputError(f"{name}: {where} must be JSON [[[x, y], ...], ...] ({error})") from error
    if not polygons:
        raise InputError(f"{name}: {where} holds no polygon, it must hold at least one [[x, y], ...]")
    return Region(name, polygons)


def _mask(name: str, path: Path) -> Region:
    mask = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    if mask is None:
        raise InputError(f"{name}: {path} cannot be read as a picture, it must be a PNG mask or a .json of polygons")
    colours = mask[..., :3] if mask.ndim == 3 else mask[..., None]  # not the alpha channel
    return Region(name, mask=colours.any(axis=2))
