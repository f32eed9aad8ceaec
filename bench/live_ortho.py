"""Georeferencing live, 1080p at 30 frames/s: camera, tracker, georeferencing and a follower, each a process, over DDS.

python bench/live_ortho.py [SECONDS]    On two cores; prints a table, and the load of the machine before it.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from live_processes import ProcessSample, encoded, start_python, stopped, there_and_back, write_loop
from machine import use_two_cores
from scenes import HD, Scene, render
from spread import Spread
from tables import Table, number

SHARED_MEMORY = Path("/dev/shm") if Path("/dev/shm").is_dir() else None
_HERE = Path(__file__).resolve().parent
_DOMAIN, _LOOK_S, _RATE_HZ, _LOOPED = 173, 0.1, 30.0, 31
_SETTLING_S = 3.0  # at the beginning, with the start of the tracker and the frames that wait for it
_HEIGHT_M = 30.0  # with the focal length of the follower's camera: 2 cm
_HEAD = ("stream", "sent", "homographies", "median, ms", "95 %", "ortho_info", "median, ms", "95 %", "max",
         "image_ortho", "median, ms", "95 %", "max", "CPU of tracker, ms", "of georeferencing, ms")
_NOTE = ("After the first {:g} s. How late: from publication of the image to reception, in another process. CPU: for "
         "each image answered. Load of the machine (1 min) before and after: {:.1f}, {:.1f}.")


@dataclass(frozen=True)
class OrthoCase:
    """images: image_ortho is subscribed. k1: of the lens; 0: a pinhole."""

    encoding: str
    images: bool
    k1: float

    @property
    def name(self) -> str:
        return f"{self.encoding}{', image_ortho' if self.images else ''}{', lens' if self.k1 else ''}"


_CASES = (OrthoCase("bgr8", False, 0.0), OrthoCase("bgr8", True, 0.0), OrthoCase("bgr8", True, -0.05),
          OrthoCase("mono8", True, 0.0))


def main(seconds: float) -> None:
    """All cases, one after the other."""
    use_two_cores()
    scene, before = render("kolubara", HD, _LOOPED), os.getloadavg()[0]
    rows = [_run(case, scene, seconds) for case in _CASES]
    note = _NOTE.format(_SETTLING_S, before, os.getloadavg()[0])
    print(Table(f"Georeferencing live, {HD[0]}x{HD[1]} at {_RATE_HZ:g} Hz", _HEAD, rows, note).text())


def _run(case: OrthoCase, scene: Scene, seconds: float) -> tuple[str, ...]:
    with tempfile.TemporaryDirectory(dir=SHARED_MEMORY) as folder:
        bag = Path(folder) / "loop.mcap"
        write_loop(bag, (encoded(frame, case.encoding) for frame in there_and_back(scene)))
        ortho = _start("-m", "stab_ros.nodes.georeference", "--ros-args", "-p", "orientation:=dynamic_stabilization",
                       "-p", f"height_m:={_HEIGHT_M}", "-p", "wait_for_subscribers:=1")
        tracker = _start("-m", "stab_ros.nodes.tracker", "--ros-args", "-p", "use_camera_info:=true", "-p",
                         "wait_for_subscribers:=2")
        follower = _start(str(_HERE / "one_ortho_follower.py"), str(int(case.images)), str(case.k1))
        camera = _start(str(_HERE / "one_camera.py"), str(bag), str(_RATE_HZ), str(round(seconds * _RATE_HZ)), "2")
        samples = _watched((tracker, ortho), camera)
        sent_ns = json.loads(camera.communicate()[0])
        time.sleep(1.0)
        said = [stopped(process) for process in (tracker, ortho, follower)][-1]
    return _row(case, sent_ns, json.loads(said), samples)


def _start(*arguments: str) -> subprocess.Popen[bytes]:
    return start_python(_DOMAIN, *arguments, stdout=subprocess.PIPE)


def _watched(nodes: tuple[subprocess.Popen[bytes], ...], camera: subprocess.Popen[bytes]) -> list[
        tuple[ProcessSample, ...]]:
    """The nodes, until the camera has ended."""
    samples = []
    while camera.poll() is None:
        samples.append(tuple(ProcessSample.of(node.pid) for node in nodes))
        time.sleep(_LOOK_S)
    return samples


def _row(case: OrthoCase, sent_ns: list[int], said: Mapping[str, list[tuple[int, float]]],
         samples: list[tuple[ProcessSample, ...]]) -> tuple[str, ...]:
    begin_ns = sent_ns[0] + round(_SETTLING_S * 1e9)
    sent = sum(stamp >= begin_ns for stamp in sent_ns)
    begin, end = (min(samples, key=lambda sample: abs(sample[0].time_ns - stamp)) for stamp in (begin_ns, sent_ns[-1]))
    cells = [case.name, str(sent)]
    for topic in ("homography", "ortho_info", "image_ortho"):
        spread = Spread.of([late for stamp, late in said[topic] if stamp >= begin_ns])
        shown = (spread.median, spread.p95) if topic == "homography" else (spread.median, spread.p95, spread.max)
        cells += [str(spread.count), *(number(value, 1) for value in shown)]
    worked = [sum(stamp >= begin_ns for stamp, _ in said[topic]) for topic in ("homography", "ortho_info")]
    used_ms = (1e3 * (last.processor_s - first.processor_s) / count
               for first, last, count in zip(begin, end, worked, strict=True))
    return (*cells, *(number(value, 1) for value in used_ms))


if __name__ == "__main__":
    main(float(sys.argv[1]) if len(sys.argv) > 1 else 30.0)
