"""Memory of a process that tracks and warps one stream, and whether it grows."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from effort import Effort
from scenes import HD, UHD, render
from tables import Section, Table

FLAT_MB = 2.0  # growth between the first sample and the last that still counts as flat
_PICTURES = 8
_CHILD = Path(__file__).with_name("one_stream.py")


@dataclass(frozen=True)
class Footprint:
    """anonymous_mb: RssAnon after so many frames. peak_mb: VmHWM, in which the pictures themselves are."""

    frames: int
    lost: int
    anonymous_mb: dict[int, float]
    peak_anonymous_mb: float
    peak_mb: float
    pictures_mb: float

    @property
    def growth_mb(self) -> float:
        """From the first sample to the last."""
        samples = list(self.anonymous_mb.values())
        return samples[-1] - samples[0]


def measure(effort: Effort) -> Section:
    """1080p for long, and the peak at 4K."""
    rows, data = [], {}
    for size, count in zip((HD, UHD), effort.stream, strict=True):
        footprint = _of_stream(size, count)
        name = f"{size[0]}x{size[1]}"
        rows.append(_row(name, footprint))
        data[name] = asdict(footprint) | {"growth_mb": footprint.growth_mb}
    head = ("MB", "frames", "lost", "after 10 %", "50 %", "100 %", "growth", "flat", "peak", "peak RSS")
    note = ("RssAnon of a process that tracks and warps mono8 and does nothing else. RSS: with libraries and the "
            f"{_PICTURES} pictures it loops over. Flat: growth from 10 % of the frames on below {FLAT_MB:g} MB.")
    return Section("Memory", [Table("Resident memory of one stream", head, rows, note)], data | {"flat_mb": FLAT_MB})


def _of_stream(size: tuple[int, int], count: int) -> Footprint:
    scene = render("kolubara", size, _PICTURES)
    with tempfile.TemporaryDirectory() as folder:
        pictures = Path(folder) / "pictures.npy"
        np.save(pictures, np.stack([frame.image for frame in scene.frames]))
        _child(pictures, 2, [2])  # compiles, if need be: what the compiler leaves in memory is not the stream's
        return _child(pictures, count, [count // 10, count // 2, count])


def _child(pictures: Path, count: int, samples: list[int]) -> Footprint:
    words = [sys.executable, str(_CHILD), str(pictures), str(count), *map(str, samples)]
    told = json.loads(subprocess.run(words, check=True, stdout=subprocess.PIPE, text=True).stdout)
    return Footprint(
        told["frames"], told["lost"], {int(frame): kb / 1024 for frame, kb in told["anonymous_kb"].items()},
        told["peak_anonymous_kb"] / 1024, told["peak_kb"] / 1024, told["pictures_kb"] / 1024,
    )  # fmt: skip


def _row(name: str, footprint: Footprint) -> tuple[str, ...]:
    samples = [f"{mb:.0f}" for mb in footprint.anonymous_mb.values()]
    flat = "yes" if footprint.growth_mb < FLAT_MB else "NO"
    return (name, str(footprint.frames), str(footprint.lost), *samples, f"{footprint.growth_mb:+.1f}", flat,
            f"{footprint.peak_anonymous_mb:.0f}", f"{footprint.peak_mb:.0f}")
