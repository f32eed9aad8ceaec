"""A process that does nothing but track and warp; prints its memory as JSON.

python bench/one_stream.py FRAMES.npy COUNT SAMPLE...    FRAMES.npy: (n, h, w) uint8, walked back and forth
"""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from stab_ros.core.types import Frame
from stab_ros.parameters.engines import make_stabilizer

_STEP_NS = 40_000_000


def main(arguments: Sequence[str]) -> None:
    """The frames stay a file mapped into memory: they are no anonymous memory, which is what is looked at."""
    pictures = np.load(arguments[0], mmap_mode="r")
    count, samples = int(arguments[1]), {int(word) for word in arguments[2:]}
    stabilizer, turn = make_stabilizer({}), len(pictures) - 1
    anonymous_kb: dict[int, int] = {}
    peak_kb = lost = 0
    for number in range(count):
        image = pictures[turn - abs(turn - number % (2 * turn))]
        done = stabilizer.step(Frame(image, "mono8", (number + 1) * _STEP_NS))
        lost += not done.track.tracked
        now_kb = _status_kb("RssAnon")
        peak_kb = max(peak_kb, now_kb)
        if number + 1 in samples:
            anonymous_kb[number + 1] = now_kb
    print(json.dumps({"frames": count, "lost": lost, "anonymous_kb": anonymous_kb, "peak_anonymous_kb": peak_kb,
                      "peak_kb": _status_kb("VmHWM"), "pictures_kb": pictures.nbytes // 1024}))


def _status_kb(key: str) -> int:
    """A figure of this process, as the kernel tells it."""
    lines = Path("/proc/self/status").read_text(encoding="utf-8").splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith(f"{key}:"))


if __name__ == "__main__":
    main(sys.argv[1:])
