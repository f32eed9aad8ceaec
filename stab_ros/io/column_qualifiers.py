"""What stands beside the name of a column and is no unit: an axis, a reference system, a datum, a picture."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

_AXES: Mapping[str, str] = MappingProxyType({
    **dict.fromkeys(("e", "east"), "east"), **dict.fromkeys(("n", "north"), "north"), "up": "up",
    **dict.fromkeys(("w", "west"), "west"), **dict.fromkeys(("s", "south"), "south"),
    **dict.fromkeys(("col", "column", "u"), "px"), **dict.fromkeys(("row", "v"), "py")})
_SYSTEM = re.compile(  # the last letter of a zone is no m, which is the unit
    r"\b(?:(?:utm|epsg|wgs|nad|navd|ngvd|etrs|evrf|itrf|gda|egm|ellipsoid|ortho|zone)[a-z]*"
    r"(?:\W*(?<!\d)\d+(?: ?(?:n|s|north|south)\b|[a-ln-z])?)*|local|a?msl|asl)\b")
_AXIS = re.compile(rf"\b(?:{'|'.join(_AXES)})\b")
_IMAGE = re.compile(r"\bimage\b")
_DOTS = re.compile(r"(?<=\b[a-z])\.(?=[a-z]\b)")  # of a.s.l. and U.S.
_MARKS = " ,;:/()[]-."


@dataclass(frozen=True)
class Qualifier:
    """What stands beside the name of a column.

    Attributes:
        unit: in small letters; "" where none is.
        axis: east, north, up, west, south, px or py; "" where none is.
        of_map: whether a reference system or a datum is named.
        of_image: whether a picture is.
    """

    unit: str = ""
    axis: str = ""
    of_map: bool = False
    of_image: bool = False


def qualifier_of(text: str) -> Qualifier:
    """Parts a text as `UTM 33N, m`, `US ft NAVD88` or `col` into the unit and what is none."""
    words = _DOTS.sub("", text.lower().replace("_", " "))
    unit, systems = _SYSTEM.subn(" ", words)
    unit, images = _IMAGE.subn(" ", unit)
    axes = [_AXES[word] for word in _AXIS.findall(unit)]
    unit = " ".join(_AXIS.sub(" ", unit).strip(_MARKS).split())
    return Qualifier(unit, axes[0] if axes else "", systems > 0, images > 0)
