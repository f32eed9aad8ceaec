"""A process that finds points with OpenPIV; runs in OpenPIV's own environment.

of_openpiv.py FRAMES.npy    FRAMES.npy: (n, h, w) uint8, the first is the reference; in: {"frame": its number, "how":
one of HOW, "points_px": [[x, y], ...] in the reference, "starts_px": where to look}; out: {"ms", "found_px"}
"""

from __future__ import annotations

import importlib
import json
import sys
from collections.abc import Callable, Mapping, Sequence
from importlib.metadata import version
from time import perf_counter_ns
from typing import Any

import numpy as np

SIDES_PX = (32, 16)
_WIDE_PX = 96  # of the picture that windows are deformed in; with less its splines have too few vectors

pyprocess: Any = importlib.import_module("openpiv.pyprocess")
windef: Any = importlib.import_module("openpiv.windef")
settings: Any = importlib.import_module("openpiv.settings")


def by_areas(reference: Any, current: Any, point: Any, shift: Any) -> Any:
    """Displacement, px, by two passes of one interrogation area each; the second begins where the first ended."""
    found = shift
    for side in SIDES_PX:
        begin = np.round(found)
        u, v, _ = pyprocess.extended_search_area_piv(
            _cut(reference, point, side), _cut(current, point + begin, side), window_size=side, overlap=0,
            search_area_size=side)  # fmt: skip
        found = begin + np.array([u[0, 0], v[0, 0]])
    return found


def by_windef(reference: Any, current: Any, point: Any, shift: Any) -> Any:
    """Displacement, px, by two passes with window deformation: the vector in the middle of the field."""
    begin = np.round(shift)
    of_passes = settings.PIVSettings(windowsizes=SIDES_PX, overlap=tuple(side // 2 for side in SIDES_PX),
                                     num_iterations=len(SIDES_PX))
    _, _, u, v, _ = windef.simple_multipass(_cut(reference, point, _WIDE_PX), _cut(current, point + begin, _WIDE_PX),
                                            of_passes)
    middle = u.shape[0] // 2
    return begin + np.array([u[middle, middle], -v[middle, middle]])  # its y is up


def _cut(picture: Any, centre: Any, side: int) -> Any:
    """(side, side): the area about a centre that lies half a pixel beside whole ones."""
    left, top = np.round(np.asarray(centre) - (side - 1) / 2).astype(int)
    return np.ascontiguousarray(picture[top : top + side, left : left + side], dtype=np.float64)


HOW: Mapping[str, Callable[[Any, Any, Any, Any], Any]] = {"areas": by_areas, "windef": by_windef}


def _found(pictures: Any, question: Mapping[str, Any]) -> dict[str, object]:
    find, current = HOW[question["how"]], np.asarray(pictures[question["frame"]])
    points, starts = np.array(question["points_px"]), np.array(question["starts_px"])
    start_ns = perf_counter_ns()
    found = [point + find(pictures[0], current, point, start - point)
             for point, start in zip(points, starts, strict=True)]
    return {"ms": (perf_counter_ns() - start_ns) / 1e6, "found_px": np.array(found).tolist()}


def main(arguments: Sequence[str]) -> None:
    """Answers until there are no more questions."""
    answers, sys.stdout = sys.stdout, sys.stderr  # for what the package prints
    pictures = np.load(arguments[0], mmap_mode="r")
    print(json.dumps(version("openpiv")), file=answers, flush=True)
    for line in sys.stdin:
        print(json.dumps(_found(pictures, json.loads(line))), file=answers, flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
