"""A process that stabilises with stabilo, as it is set by default; runs in stabilo's own environment.

of_stabilo.py FRAMES.npy    FRAMES.npy: (n, h, w) uint8, the first is the reference; a number in, {"ms", "with_warp_ms",
"H"} out
"""

from __future__ import annotations

import importlib
import json
import sys
from importlib.metadata import version
from time import perf_counter_ns

import cv2
import numpy as np


def main(path: str) -> None:
    """Answers until there are no more questions."""
    answers, sys.stdout = sys.stdout, sys.stderr  # for what the package prints
    pictures = np.load(path, mmap_mode="r")
    stabilizer = importlib.import_module("stabilo").Stabilizer()
    stabilizer.set_ref_frame(cv2.cvtColor(pictures[0], cv2.COLOR_GRAY2BGR))
    print(json.dumps(version("stabilo")), file=answers, flush=True)
    for line in sys.stdin:
        bgr = cv2.cvtColor(pictures[json.loads(line)], cv2.COLOR_GRAY2BGR)  # it takes nothing else
        start_ns = perf_counter_ns()
        stabilizer.stabilize(bgr)
        tracked_ns, H = perf_counter_ns(), stabilizer.get_cur_trans_matrix()
        stabilizer.warp_cur_frame()
        told = {"ms": (tracked_ns - start_ns) / 1e6, "with_warp_ms": (perf_counter_ns() - start_ns) / 1e6}
        print(json.dumps(told | {"H": None if H is None else np.asarray(H).tolist()}), file=answers, flush=True)


if __name__ == "__main__":
    main(sys.argv[1])
