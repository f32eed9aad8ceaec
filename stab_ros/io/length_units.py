"""Units of length as headers of tables name them."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Protocol

from stab_ros.core.errors import InputError
from stab_ros.core.text import one_line
from stab_ros.georeferencing.unit_checks import FOOT_M

_SURVEY_FOOT_M = 1200 / 3937
LENGTHS: Mapping[str, float] = MappingProxyType({  # in small letters: metres
    **dict.fromkeys(("m", "meter", "meters", "metre", "metres"), 1.0), "cm": 0.01, "mm": 0.001, "km": 1000.0,
    **dict.fromkeys(("ft", "feet", "foot"), FOOT_M),
    **dict.fromkeys(("us ft", "us survey ft", "us survey feet", "us survey foot", "ftus", "usft"), _SURVEY_FOOT_M)})
FEET = frozenset({FOOT_M, _SURVEY_FOOT_M})
# a unit behind the last space or _ of a header, as in `Z_ft`
LENGTH_PATTERN = (r"m|meters?|metres?|cm|mm|km|"
                  r"(?:us[ _-]?)?(?:survey[ _-]?)?(?:ft|feet|foot)(?:[ _-]?us)?(?:[ _-]?survey)?")
LENGTHS_TEXT = "m, cm, mm, km, ft or US ft"
_FEET, _SURVEY = {"ft", "feet", "foot"}, {"us", "survey"}
_ABOVE_SEA = ("masl", "mamsl")


class LengthColumn(Protocol):
    """A column of lengths: metres of one unit, the unit as named, "" where none is, and the header as written."""

    @property
    def metres(self) -> float: ...

    @property
    def unit(self) -> str: ...

    @property
    def header(self) -> str: ...


def check_units(path: Path, places: Sequence[LengthColumn], height: LengthColumn | None) -> None:
    """Raises InputError where columns name no unit and that of others leaves open which it is.

    Args:
        path: of the table, for the message.
        places: east and north, or distances.
        height: None: there is none.
    """
    first = places[0]
    for other in places[1:]:
        if first.metres != other.metres or bool(first.unit) != bool(other.unit):
            raise InputError(f"{path}: the columns {one_line(first.header)} and {one_line(other.header)} must be in "
                             "one unit, which both or neither must name")
    if height is None:
        return
    beside_feet = len(places) == 1 and height.metres in FEET  # distances beside a depth (cm) are metres
    for named, other, is_open in ((first, height, first.metres != 1), (height, first, beside_feet)):
        if is_open and not other.unit:
            raise InputError(f"{path}: the column {one_line(other.header)} must name its unit, as "
                             f"{one_line(named.header)} does")


def metres_of(unit: str) -> float | None:
    """Metres of one unit, as `ft`, `US-ft`, `foot_US`, `m a.s.l.`, whatever follows it; None: it is unknown.

    A foot with the word US or survey anywhere is the US survey foot.
    """
    words = re.findall(r"[a-z]+|\d+", unit.lower())
    if not words:
        return None
    if words[0] in _FEET | _SURVEY and _FEET & set(words):
        return _SURVEY_FOOT_M if _SURVEY & set(words) else FOOT_M
    return 1.0 if words[0] in _ABOVE_SEA else LENGTHS.get(words[0])
