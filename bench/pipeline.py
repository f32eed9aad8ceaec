"""Tracker and velocimetry in one process beside two of them: processor time of an image, and how late the answers come.

python bench/pipeline.py [SECONDS] [RATE_HZ] [ENCODING ...]    1080p on two cores; both kinds in turn.

ENCODING: mono8, bgr8, or jpeg for compressed images in colour; all of them by default.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

from live_processes import ProcessSample, encoded, start_python, stopped, there_and_back, write_loop
from machine import use_two_cores
from scenes import HD, render
from spread import Spread
from tables import Table, number

_HERE = Path(__file__).resolve().parent
_DOMAIN, _LOOK_S, _LOOPED = 171, 0.1, 26
_SETTLING_S = 5.0  # at the beginning, with the start of the tracker and the frames that wait for it
_OF_VELOCIMETRY = ("gsd_m:=0.02", "use_camera_info:=false")
_KINDS = ("two processes", "one process")
_HEAD = ("stream", "", "sent", "answered", "CPU for an answered image, ms", "homography: median, ms", "95 %",
         "velocity: median", "95 %", "RssAnon, MB")
_NOTE = ("{:g} s at {:g} Hz each, after {:g} s. How late: from publication of the last image to reception elsewhere. "
         "CPU: of tracker and velocimetry, all threads. Load of the machine (1 min) before and after: {:.1f}, "
         "{:.1f}.")


def main(seconds: float, rate_hz: float, encodings: Sequence[str]) -> None:
    """Both kinds in turn, for each encoding."""
    use_two_cores()
    before, scene = os.getloadavg()[0], render("kolubara", HD, _LOOPED)
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for encoding in encodings:
            bag = Path(folder) / f"{encoding}.mcap"
            jpeg = encoding == "jpeg"
            write_loop(bag, (encoded(gray, "bgr8" if jpeg else encoding) for gray in there_and_back(scene)), jpeg)
            for kind in _KINDS:
                rows.append((encoding, kind, *_run(kind, bag, encoding, rate_hz, seconds + _SETTLING_S)))
    note = _NOTE.format(seconds, rate_hz, _SETTLING_S, before, os.getloadavg()[0])
    print(Table(f"Tracker and velocimetry live, {HD[0]}x{HD[1]}", _HEAD, rows, note).text())


def _run(kind: str, bag: Path, encoding: str, rate_hz: float, seconds: float) -> tuple[str, ...]:
    nodes = _started(kind, "compressed" if encoding == "jpeg" else "raw")
    follower = start_python(_DOMAIN, str(_HERE / "one_velocity_follower.py"), stdout=subprocess.PIPE)
    camera = start_python(_DOMAIN, str(_HERE / "one_camera.py"), str(bag), str(rate_hz), str(round(seconds * rate_hz)),
                          str(len(nodes)), stdout=subprocess.PIPE)
    samples = _watched(nodes, camera)
    sent_ns = json.loads(camera.communicate()[0])
    time.sleep(2.0)
    said = json.loads([stopped(process) for process in (*nodes, follower)][-1])
    return _row(samples, sent_ns, said)


def _started(kind: str, transport: str) -> list[subprocess.Popen[bytes]]:
    both = (f"image_transport:={transport}",)
    if kind == "one process":
        return [_start("pipeline", *both, "nodes:=[tracker, velocimetry]", "wait_for_nodes:=2",
                       "tracker_node:wait_for_subscribers:=2",
                       *(f"velocimetry_node:{one}" for one in _OF_VELOCIMETRY))]
    return [_start("tracker", *both, "wait_for_subscribers:=2"), _start("velocimetry", *both, *_OF_VELOCIMETRY)]


def _start(node: str, *parameters: str) -> subprocess.Popen[bytes]:
    words = [word for one in parameters for word in ("-p", one)]
    return start_python(_DOMAIN, "-m", f"stab_ros.nodes.{node}", "--ros-args", *words, stdout=subprocess.PIPE)


def _watched(nodes: Sequence[subprocess.Popen[bytes]], camera: subprocess.Popen[bytes]) -> list[list[ProcessSample]]:
    """The nodes, until the camera has ended."""
    samples = []
    while camera.poll() is None:
        samples.append([ProcessSample.of(node.pid) for node in nodes])
        time.sleep(_LOOK_S)
    return samples


def _row(samples: Sequence[Sequence[ProcessSample]], sent_ns: Sequence[int],
         said: Mapping[str, Sequence[tuple[int, float]]]) -> tuple[str, ...]:
    begin_ns = sent_ns[0] + round(_SETTLING_S * 1e9)
    sent = sum(stamp >= begin_ns for stamp in sent_ns)
    late = {topic: [ms for stamp, ms in said[topic] if stamp >= begin_ns] for topic in ("homography", "velocity")}
    begin, end = (min(samples, key=lambda look: abs(look[0].time_ns - at)) for at in (begin_ns, sent_ns[-1]))
    cpu_s = sum(one.processor_s for one in end) - sum(one.processor_s for one in begin)
    homography, velocity = Spread.of(late["homography"]), Spread.of(late["velocity"])
    shown = (1e3 * cpu_s / max(homography.count, 1), homography.median, homography.p95, velocity.median, velocity.p95)
    return (str(sent), str(homography.count), *(number(value, 1) for value in shown),
            number(sum(one.anonymous_mb for one in end), 0))


if __name__ == "__main__":
    main(float(sys.argv[1]) if len(sys.argv) > 1 else 15.0, float(sys.argv[2]) if len(sys.argv) > 2 else 25.0,
         sys.argv[3:] or ("mono8", "bgr8", "jpeg"))
