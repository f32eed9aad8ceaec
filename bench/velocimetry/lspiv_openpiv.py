"""A process that measures with OpenPIV; runs in OpenPIV's own environment.

lspiv_openpiv.py FRAMES.npz OUT.npz    FRAMES.npz: frames (n, h, w) uint8, gap, window; OUT.npz: x, y, u, v in px, the
median over the pairs (y downwards), and ms of a frame, wall and processor
"""

from __future__ import annotations

import importlib
import sys
from time import perf_counter_ns, process_time_ns
from typing import Any

import numpy as np

pyprocess: Any = importlib.import_module("openpiv.pyprocess")


def main(frames_path: str, out_path: str) -> None:
    """Each pair by itself, as OpenPIV does it, then the median over the pairs."""
    data = np.load(frames_path)
    frames, gap, window = data["frames"].astype(np.int32), int(data["gap"]), int(data["window"])
    begin_ns, cpu_ns = perf_counter_ns(), process_time_ns()
    found = [pyprocess.extended_search_area_piv(frames[i], frames[i + gap], window_size=window, overlap=window // 2,
                                                search_area_size=window)[:2]
             for i in range(0, len(frames) - gap, gap)]
    u, v = np.nanmedian(np.array(found), axis=0)
    x, y = pyprocess.get_coordinates(frames[0].shape, window, window // 2)
    ms = np.array([perf_counter_ns() - begin_ns, process_time_ns() - cpu_ns]) / 1e6 / len(frames)
    np.savez(out_path, x=x, y=y, u=u, v=v, ms=ms)


if __name__ == "__main__":
    main(*sys.argv[1:])
