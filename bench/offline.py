"""`stab-ros stabilize`, bag to bag, beside the engine alone on the same pictures, both in turn."""

from __future__ import annotations

import tempfile
from pathlib import Path
from time import perf_counter

from effort import Effort
from live import SHARED_MEMORY
from scenes import HD, Scene, render
from spread import Spread
from tables import Section, Table, number

from stab_ros.io.bag import BagWriter, topic_of
from stab_ros.io.cdr import IMAGE, header_of
from stab_ros.io.image_message import image_cdr
from stab_ros.jobs.stabilize import Job, stabilize
from stab_ros.parameters.engines import make_stabilizer

TARGET = 0.6  # of the engine's rate
_ROUNDS = 5


def measure(effort: Effort) -> Section:
    """1080p, mono8, not compressed, in memory."""
    scene = render("kolubara", HD, effort.rendered)
    ratios, rates = [], {"engine": list[float](), "bag to bag": list[float]()}
    with tempfile.TemporaryDirectory(dir=SHARED_MEMORY) as folder:
        bag = Path(folder) / "flight.mcap"
        _write(bag, scene, effort.recorded)
        for _ in range(_ROUNDS):
            rates["engine"].append(_engine_hz(scene, effort.recorded))
            rates["bag to bag"].append(_bag_hz(bag, Path(folder) / "out.mcap"))
            ratios.append(rates["bag to bag"][-1] / rates["engine"][-1])
    medians = {name: Spread.of(found).median for name, found in rates.items()}
    share = Spread.of(ratios).median
    rows = [(name, number(rate, 1)) for name, rate in medians.items()]
    note = (f"{effort.recorded} frames, {_ROUNDS} rounds, medians. Engine: track and warp of pictures in memory. Bag "
            f"to bag at {share:.2f} of its rate; target {TARGET:g}, {'met' if share >= TARGET else 'NOT met'}.")
    table = Table(f"{HD[0]}x{HD[1]} mono8 on tmpfs", ("", "frames/s"), rows, note)
    return Section("Offline", [table], {"frames_per_s": medians, "share": share, "target": TARGET})


def _write(path: Path, scene: Scene, count: int) -> None:
    with BagWriter(path) as writer:
        writer.add_topic(topic_of("/camera/image_raw", IMAGE))
        for frame, _ in scene.back_and_forth(count):
            writer.write("/camera/image_raw", frame.stamp_ns, frame.stamp_ns,
                         image_cdr(frame.image, frame.encoding, header_of(frame)))


def _engine_hz(scene: Scene, count: int) -> float:
    """With the late start of the command."""
    stabilizer, start_s = make_stabilizer({}), perf_counter()
    waiting = []
    for frame, _ in scene.back_and_forth(count):
        waiting.append(frame)
        for track in stabilizer.answers(frame):
            stabilizer.warp(waiting.pop(0), track)
    for track in stabilizer.finish():
        stabilizer.warp(waiting.pop(0), track)
    return count / (perf_counter() - start_s)


def _bag_hz(bag: Path, output: Path) -> float:
    summary = stabilize(Job(bag, output, {}, force=True), lambda _done, _of: None)
    return summary.frames / summary.duration_s
