"""Units of length as headers of tables name them."""

from __future__ import annotations

import re
from collections.abc import Mapping
from types import MappingProxyType

from stab_ros.georeferencing.unit_checks import FOOT_M

_SURVEY_FOOT_M = 1200 / 3937
LENGTHS: Mapping[str, float] = MappingProxyType({  # in small letters: metres
    **dict.fromkeys(("m", "meter", "meters", "metre", "metres"), 1.0), "cm": 0.01, "mm": 0.001, "km": 1000.0,
    **dict.fromkeys(("ft", "feet", "foot"), FOOT_M),
    **dict.fromkeys(("us ft", "us survey ft", "us survey feet", "us survey foot", "ftus", "usft"), _SURVEY_FOOT_M)})
LENGTHS_TEXT = "m, cm, mm, km, ft or US ft"
_FEET, _SURVEY = {"ft", "feet", "foot"}, {"us", "survey"}
_ABOVE_SEA = ("masl", "mamsl")


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
