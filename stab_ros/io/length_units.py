"""Units of length as headers of tables name them."""

from __future__ import annotations

import re
from collections.abc import Mapping
from types import MappingProxyType

_FOOT, _SURVEY_FOOT = 0.3048, 1200 / 3937
LENGTHS: Mapping[str, float] = MappingProxyType({  # in small letters: metres
    **dict.fromkeys(("m", "meter", "meters", "metre", "metres"), 1.0), "cm": 0.01, "mm": 0.001, "km": 1000.0,
    **dict.fromkeys(("ft", "feet", "foot"), _FOOT),
    **dict.fromkeys(("us ft", "us survey ft", "us survey feet", "us survey foot", "ftus", "usft"), _SURVEY_FOOT)})
LENGTHS_TEXT = "m, cm, mm, km, ft or US ft"
_MOST_WORDS = 3
_ABOVE_SEA = ("masl", "mamsl")


def metres_of(unit: str) -> float | None:
    """Metres of one unit, as `ft`, `US-ft`, `m a.s.l.`, whatever follows it, as a datum; None: it is unknown."""
    words = re.findall(r"[a-z]+", unit.lower())
    if words and words[0] in _ABOVE_SEA:
        return 1.0
    begins = (" ".join(words[:count]) for count in range(_MOST_WORDS, 0, -1))
    return next((LENGTHS[name] for name in begins if name in LENGTHS), None)
