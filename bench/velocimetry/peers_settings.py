"""With which settings everyone measures: the usual ones, and the best of a small sweep on another seed.

The usual ones are ours by default; OpenPIV's `PIVSettings`; and those of pyorc's example ngwerere. CHOSEN is what
`peers_velocity.py --sweep` prints.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

Settings = Mapping[str, Any]
_GAPS = (2, 4, 8, 12, 16, 24)  # frames from one picture of a pair to the other


@dataclass(frozen=True)
class Way:
    """A way to measure. package: whose process does it. swept: settings that are tried instead of the usual ones."""

    name: str
    package: str
    usual: Settings
    swept: Sequence[Settings] = ()


def _openpiv() -> list[Settings]:
    passes = ((64, 32, 16), (64, 32))
    return [{"windows": list(sides), "gap": gap} for sides, gap in product(passes, _GAPS)]


def _pyorc() -> list[Settings]:
    tried = product((32, 48, 64), _GAPS, (False, True))
    return [{"window": side, "gap": gap, "normalize": True, "edges": False, "ensemble": ensemble, "slowest_m_s": 0.01}
            for side, gap, ensemble in tried]


WAYS = (
    Way("particles", "ours", {"method": "particles"},
        [{"method": "particles", "extract_s": seconds, "block_px": side} for seconds, side in
         product((1.0, 2.0), (21, 31))]),
    Way("lspiv", "ours", {"method": "lspiv"},
        [{"method": "lspiv", "window_px": side} for side in (24, 32)]),
    Way("stiv", "ours", {"method": "stiv", "interval_s": 2.0}),
    Way("OpenPIV", "openpiv", {"windows": [64, 32, 16], "gap": 1}, _openpiv()),
    Way("pyorc", "pyorc", {"window": 25, "gap": 1, "normalize": True, "edges": True, "ensemble": False,
                           "slowest_m_s": 0.1}, _pyorc()),
)

CHOSEN: Mapping[str, Mapping[str, Settings]] = {
    "basento": {
        "lspiv": {"method": "lspiv", "window_px": 24},
        "OpenPIV": {"windows": [64, 32, 16], "gap": 12},
        "pyorc": {"window": 48, "gap": 12, "normalize": True, "edges": False, "ensemble": True, "slowest_m_s": 0.01}},
    "basento, disturbed": {
        "particles": {"method": "particles", "extract_s": 1.0, "block_px": 21},
        "lspiv": {"method": "lspiv", "window_px": 32},
        "OpenPIV": {"windows": [64, 32, 16], "gap": 12},
        "pyorc": {"window": 48, "gap": 12, "normalize": True, "edges": False, "ensemble": True, "slowest_m_s": 0.01}},
    "kolubara": {
        "particles": {"method": "particles", "extract_s": 2.0, "block_px": 31},
        "lspiv": {"method": "lspiv", "window_px": 32},
        "OpenPIV": {"windows": [64, 32, 16], "gap": 16},
        "pyorc": {"window": 32, "gap": 12, "normalize": True, "edges": False, "ensemble": True, "slowest_m_s": 0.01}},
}
