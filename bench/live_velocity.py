"""Velocities and discharge live, 1080p at 25 frames/s: camera, tracker, velocimetry, discharge and a follower over DDS.

python bench/live_velocity.py [SECONDS] [ENCODING]    On two cores; prints a table, and the load of the machine before.
The flight is played to and fro, so the water turns back every four seconds: the figures are of time, not of velocities.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path

from live_processes import ProcessSample, encoded, start_python, stopped, there_and_back, write_loop
from machine import use_two_cores
from one_velocity_follower import TOPICS
from scenes import HD, render
from spread import Spread
from tables import Table, number

_HERE = Path(__file__).resolve().parent
_DOMAIN, _LOOK_S, _RATE_HZ, _LOOPED = 174, 0.1, 25.0, 101
_SETTLING_S = 3.0  # at the beginning, with the start of the tracker and the frames that wait for it
_HEIGHT_M = 30.0  # with the focal length of the follower's camera: 2 cm
_ACROSS_M = (19.2, 21.6)  # where the section crosses the picture, and how far
_NODES = ("tracker", "velocimetry", "discharge")
_HEAD = ("topic", "sent or due", "received", "late: median, ms", "95 %", "max")
_NOTE = ("After the first {:g} s. How late: from publication of the last image that it tells of to reception, in "
         "another process. Processor time, s for each s: {}. Load of the machine (1 min) before and after: {:.1f}, "
         "{:.1f}.")


def main(seconds: float, encoding: str) -> None:
    """One run."""
    use_two_cores()
    before, scene = os.getloadavg()[0], render("kolubara", HD, _LOOPED)
    with tempfile.TemporaryDirectory() as folder:
        bag, section = Path(folder) / "loop.mcap", Path(folder) / "section.csv"
        write_loop(bag, (encoded(frame, encoding) for frame in there_and_back(scene)))
        section.write_text(_section(), encoding="utf-8")
        placing = ("-p", "orientation:=dynamic_stabilization", "-p", f"height_m:={_HEIGHT_M}")
        nodes = [_start("tracker", "-p", "use_camera_info:=true", "-p", "wait_for_subscribers:=2"),
                 _start("velocimetry", *placing),
                 _start("discharge", "-p", f"section_file:={section}", "-p", "wse_m:=0.0")]
        follower = start_python(_DOMAIN, str(_HERE / "one_velocity_follower.py"), stdout=subprocess.PIPE)
        camera = start_python(_DOMAIN, str(_HERE / "one_camera.py"), str(bag), str(_RATE_HZ),
                              str(round(seconds * _RATE_HZ)), "2", stdout=subprocess.PIPE)
        samples = _watched(nodes, camera)
        sent_ns = json.loads(camera.communicate()[0])
        time.sleep(2.0)
        said = json.loads([stopped(process) for process in (*nodes, follower)][-1])
    note = _NOTE.format(_SETTLING_S, _processor(samples, sent_ns), before, os.getloadavg()[0])
    title = f"Velocities and discharge live, {HD[0]}x{HD[1]} {encoding} at {_RATE_HZ:g} Hz"
    print(Table(title, _HEAD, _rows(sent_ns, said), note).text())


def _section() -> str:
    x, width = _ACROSS_M
    rows = [f"{x},{-width * k / 20},{min(k, 20 - k) / 10}" for k in range(21)]
    return "\n".join(["X,Y,depth", *rows]) + "\n"


def _start(node: str, *arguments: str) -> subprocess.Popen[bytes]:
    return start_python(_DOMAIN, "-m", f"stab_ros.nodes.{node}", "--ros-args", *arguments, stdout=subprocess.PIPE)


def _watched(nodes: list[subprocess.Popen[bytes]],
             camera: subprocess.Popen[bytes]) -> list[tuple[ProcessSample, ...]]:
    """The nodes, until the camera has ended."""
    samples = []
    while camera.poll() is None:
        samples.append(tuple(ProcessSample.of(node.pid) for node in nodes))
        time.sleep(_LOOK_S)
    return samples


def _rows(sent_ns: list[int], said: Mapping[str, list[tuple[int, float]]]) -> list[tuple[str, ...]]:
    begin_ns = sent_ns[0] + round(_SETTLING_S * 1e9)
    lasted_s = (sent_ns[-1] - begin_ns) / 1e9
    due = {"homography": sum(stamp >= begin_ns for stamp in sent_ns), "velocity": int(lasted_s),
           "velocity_grid": int(lasted_s), "discharge": int(lasted_s / 10)}
    rows = []
    for topic in TOPICS:
        spread = Spread.of([late for stamp, late in said[topic] if stamp >= begin_ns])
        rows.append((topic, str(due[topic]), str(spread.count),
                     *(number(value, 1) for value in (spread.median, spread.p95, spread.max))))
    return rows


def _processor(samples: list[tuple[ProcessSample, ...]], sent_ns: list[int]) -> str:
    """Share of a core that each node takes."""
    ends = (sent_ns[0] + round(_SETTLING_S * 1e9), sent_ns[-1])
    begin, end = (min(samples, key=lambda sample: abs(sample[0].time_ns - stamp)) for stamp in ends)
    shares = ((last.processor_s - first.processor_s) / ((last.time_ns - first.time_ns) / 1e9)
              for first, last in zip(begin, end, strict=True))
    return ", ".join(f"{node} {share:.2f}" for node, share in zip(_NODES, shares, strict=True))


if __name__ == "__main__":
    main(float(sys.argv[1]) if len(sys.argv) > 1 else 60.0, sys.argv[2] if len(sys.argv) > 2 else "mono8")
