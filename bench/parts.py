"""Where one track spends its time, as the profiler sees it."""

from __future__ import annotations

import cProfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from scenes import Scene
from tables import Table, number

from stab_ros.parameters.engines import make_stabilizer

# what is told apart, by file and function; none of them calls another of them
PARTS = {
    "pyramid of the frame, where it jumps": ("direct", "build_pyramid"),
    "sampling patches": ("patches", "measure_patches"),
    "fits between samplings": ("estimators", "refine"),
    "final fit": ("estimators", "fit"),
}
_WHOLE = ("stabilizer", "track")
_WARM_UP = 3


@dataclass(frozen=True)
class Shares:
    """Shares of the time of a track, by part; they add up to 1."""

    shares: Mapping[str, float]

    def table(self, title: str) -> Table:
        rows = [(part, number(100 * share, 0)) for part, share in self.shares.items()]
        return Table(title, ("part", "% of the time"), rows)


def profile(scene: Scene, frames: int) -> Shares:
    """Tracks `frames` frames under the profiler, which adds a few percent to the parts in Python."""
    stabilizer, profiler = make_stabilizer({}), cProfile.Profile()
    for number_, (frame, _) in enumerate(scene.back_and_forth(_WARM_UP + frames)):
        if number_ == _WARM_UP:
            profiler.enable()
        stabilizer.track(frame)
    profiler.disable()
    return _shares(profiler)


def _shares(profiler: cProfile.Profile) -> Shares:
    spent_s = {
        (Path(entry.code.co_filename).stem, entry.code.co_name): entry.totaltime
        for entry in profiler.getstats() if not isinstance(entry.code, str)  # those are built in
    }
    whole_s = spent_s[_WHOLE]
    shares = {part: spent_s.get(where, 0.0) / whole_s for part, where in PARTS.items()}
    return Shares(shares | {"everything else": 1 - sum(shares.values())})
