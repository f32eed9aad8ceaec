"""What all processes of the comparison have in common: frames in, vectors and processor time out.

Runs in the environment of each package, so it needs nothing but numpy. In, a line of JSON for each run: {"frames":
folder with frame_000.png and so on, "gsd_m", "fps", "settings", "out": CSV file}; out: {"cpu_s"}. The CSV has columns
x_px, y_px (y down), vx_m_s, vy_m_s (y up), dt_s: how long each vector took from its place on; 0: it is the velocity at
its place.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np

HEAD = "x_px,y_px,vx_m_s,vy_m_s,dt_s"
Read = Callable[[str], Any]  # the gray picture (h, w) uint8 of a PNG file
Measure = Callable[[Any, Mapping[str, Any]], Any]  # frames (n, h, w) and the question; the columns of the CSV, (N, 5)


def serve(version: str, read: Read, measure: Measure) -> None:
    """Answers until there are no more questions; of the time, only `measure` counts."""
    answers, sys.stdout = sys.stdout, sys.stderr  # for what a package prints
    print(json.dumps(version), file=answers, flush=True)
    frames: dict[str, Any] = {}
    for line in sys.stdin:
        question = json.loads(line)
        folder = question["frames"]
        if folder not in frames:
            frames = {folder: np.stack([read(str(path)) for path in sorted(Path(folder).glob("frame_*.png"))])}
        start_s = process_time()
        rows = measure(frames[folder], question)
        cpu_s = process_time() - start_s
        np.savetxt(question["out"], rows, delimiter=",", header=HEAD, comments="")
        print(json.dumps({"cpu_s": cpu_s}), file=answers, flush=True)
