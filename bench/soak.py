"""A long flight through player, tracker, evaluator and recorder: `python bench/soak.py [--minutes M] [--plot FILE]`.

1920x1080 mono8 at 25 frames/s over DDS, a loop of four seconds without images in the recording. What is asked: every
frame answered or counted as dropped, no memory and no file descriptors that grow. Prints Markdown; exit code 1 if a
frame is missing.
"""

from __future__ import annotations

import argparse
import json
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from live_processes import ProcessSample, start_python, there_and_back, write_loop
from machine import describe
from scenes import HD, render
from spread import Spread
from tables import Table, number
from tqdm import tqdm

from stab_ros.core.memory import keep_freed_memory
from stab_ros.core.types import Frame
from stab_ros.io.bag import open_bag
from stab_ros.io.cdr import SECOND_NS
from stab_ros.io.diagnostics_message import read_values

_DOMAIN, _LOOK_S, _WARM_UP_SHARE = 73, 5.0, 0.1
_RATE_HZ, _RENDERED = 25, 51
_FOLLOWED = ("/camera/homography", "/camera/tracker_node/track", "/camera/evaluator_node/metrics", "/diagnostics")
_ENOUGH_MB_H = 8.0  # of growth


@dataclass(frozen=True)
class FrameCounts:
    """Frames, by who has counted them."""

    published: int
    answered: int
    dropped: int
    refused: int
    before_the_first: int
    homographies_recorded: int
    metrics_recorded: int
    skipped_by_evaluator: int
    messages_lost_by_recorder: int
    stamps_back: int

    @property
    def unaccounted(self) -> int:
        return self.published - self.answered - self.dropped - self.refused - self.before_the_first


def main(arguments: Sequence[str] | None = None) -> int:
    """Flies for so many minutes and says what became of it."""
    options = _parser().parse_args(arguments)
    with tempfile.TemporaryDirectory(dir=options.folder) as folder:
        samples = _fly(Path(folder), options.minutes * 60)
        counts, late_ms = _read(Path(folder) / "out.mcap")
    print(_report(options.minutes, samples, counts, [late for _, late in late_ms]))
    if options.json:
        told = {"machine": describe(), "minutes": options.minutes, "counts": asdict(counts),
                "unaccounted": counts.unaccounted, "latency_ms": Spread.of([late for _, late in late_ms]).data(),
                "growth_mb_h": {name: _growth_mb_h(one) for name, one in samples.items()},
                "descriptors": {name: [one[0].descriptors, one[-1].descriptors] for name, one in samples.items()}}
        options.json.write_text(json.dumps(told, indent=1) + "\n", encoding="utf-8")
    if options.plot:
        _plot(samples, late_ms, options.plot)
    return int(counts.unaccounted != 0 or counts.homographies_recorded != counts.answered)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--plot", type=Path, help="memory and latency over time, a .png")
    parser.add_argument("--folder", type=Path, help="for the loop, 210 MB, and the recording")
    return parser


# the flight -----------------------------------------------------------------------------------------------------------
def _fly(folder: Path, seconds: float) -> dict[str, list[ProcessSample]]:
    """All processes, sampled while they run; the recording is `folder`/out.mcap."""
    write_loop(folder / "loop.mcap", _restamped(there_and_back(render("kolubara", HD, _RENDERED))))
    at_camera = ("-r", "__ns:=/camera", "-p", "wait_for_subscribers:=")
    processes = {
        "recorder": _start("bag_recorder", "-p", f"output:={folder / 'out.mcap'}", "-p",
                           f"topics:={json.dumps(_FOLLOWED)}"),
        "evaluator": _start("evaluator", *at_camera[:3], f"{at_camera[3]}1"),
        "tracker": _start("tracker", *at_camera[:3], f"{at_camera[3]}2"),
        "player": _start("bag_player", "-p", f"bag:={folder / 'loop.mcap'}", "-p", "loop:=true",
                         *at_camera[:3], f"{at_camera[3]}1"),
    }
    try:
        return _watched(processes, seconds)
    finally:
        for name in ("player", "tracker", "evaluator", "recorder"):
            time.sleep(3.0)  # for what is on its way, and a last report
            processes[name].send_signal(signal.SIGINT)
            processes[name].wait(60)


def _restamped(frames: Iterable[Frame]) -> Iterator[Frame]:
    """One second and more after the epoch, at the rate of the soak."""
    for index, frame in enumerate(frames, start=_RATE_HZ):
        yield replace(frame, stamp_ns=index * SECOND_NS // _RATE_HZ)


def _start(name: str, *arguments: str) -> subprocess.Popen[bytes]:
    return start_python(_DOMAIN, "-m", f"stab_ros.nodes.{name}", "--ros-args", *arguments, stderr=subprocess.DEVNULL)


def _watched(processes: Mapping[str, subprocess.Popen[bytes]], seconds: float) -> dict[str, list[ProcessSample]]:
    samples: dict[str, list[ProcessSample]] = {name: [] for name in processes}
    for _ in tqdm(range(round(seconds / _LOOK_S)), "soak", disable=None):
        time.sleep(_LOOK_S)
        for name, process in processes.items():
            if process.poll() is not None:
                raise SystemExit(f"the {name} has ended with exit code {process.returncode}")
            samples[name].append(ProcessSample.of(process.pid))
    return samples


# what came of it ------------------------------------------------------------------------------------------------------
def _read(path: Path) -> tuple[FrameCounts, list[tuple[float, float]]]:
    """What was counted, and how late a homography was, ms, by the second of the flight."""
    last: dict[str, dict[str, str]] = {}
    late_ms: list[tuple[float, float]] = []
    with open_bag(path) as bag:
        recorded = {name: topic.count for name, topic in bag.topics.items()}
        for message in bag.messages(["/diagnostics"]):
            values = read_values(message.data)
            last[_who(values)] = values
            if _who(values) == "tracker" and values["latency_ms"]:
                late_ms.append(((message.log_time_ns - bag.start_ns) / 1e9, float(values["latency_ms"])))
    tracker = {name: int(text) for name, text in last["tracker"].items() if text.isdigit()}
    return FrameCounts(
        int(last["player"]["messages"]), tracker["frames_tracked"] + tracker["frames_lost"], tracker["frames_dropped"],
        tracker["frames_refused"], tracker["frames_before"], recorded[_FOLLOWED[0]], recorded[_FOLLOWED[2]],
        int(last["evaluator"]["frames_skipped"]), int(last["recorder"]["messages_lost"]),
        tracker["stamps_back"]), late_ms


def _who(values: Mapping[str, str]) -> str:
    """Which node a report is of, by what it tells."""
    signs = {"rounds": "player", "method": "tracker", "messages_lost": "recorder"}
    return next((name for sign, name in signs.items() if sign in values), "evaluator")


def _settled(samples: Sequence[ProcessSample]) -> Sequence[ProcessSample]:
    return samples[round(_WARM_UP_SHARE * len(samples)) :]


def _growth_mb_h(samples: Sequence[ProcessSample]) -> float:
    """Slope of a straight line through RssAnon, after a tenth of the time."""
    settled = _settled(samples)
    hours = [(one.time_ns - settled[0].time_ns) / 3.6e12 for one in settled]
    return float(np.polyfit(hours, [one.anonymous_mb for one in settled], 1)[0])


def _report(minutes: float, samples: Mapping[str, Sequence[ProcessSample]], counts: FrameCounts,
            late_ms: Iterable[float]) -> str:
    rows = [(name, *(number(_settled(one)[at].anonymous_mb, 1) for at in (0, -1)), number(_growth_mb_h(one), 2),
             str(_settled(one)[0].descriptors), str(one[-1].descriptors)) for name, one in samples.items()]
    memory = Table("Memory and file descriptors, after a tenth of the time and at the end",
                   ("process", "RssAnon, MB", "at the end", f"MB/h (limit {_ENOUGH_MB_H:g})", "descriptors",
                    "at the end"), rows, "MB/h: a straight line through RssAnon after the first tenth.")
    spread = Spread.of(list(late_ms))
    lines = [f"# Soak: {minutes:g} minutes of {HD[0]}x{HD[1]} mono8 at {_RATE_HZ} frames/s", "", memory.text(), "",
             f"Latency once a second, ms: median {spread.median:.1f}, 95 % {spread.p95:.1f}, max {spread.max:.1f}", ""]
    lines += [f"- {name.replace('_', ' ')}: {count}" for name, count in asdict(counts).items()]
    return "\n".join([*lines, f"- unaccounted for: {counts.unaccounted}"])


def _plot(samples: Mapping[str, Sequence[ProcessSample]], late_ms: Sequence[tuple[float, float]], path: Path) -> None:
    mpl.use("agg")
    from matplotlib import pyplot as plt

    figure, (above, below) = plt.subplots(2, 1, sharex=True, figsize=(8, 6), layout="constrained")
    axes: Any = above
    for name, one in samples.items():
        minutes = [(sample.time_ns - one[0].time_ns) / 60e9 for sample in one]
        axes.plot(minutes, [sample.anonymous_mb for sample in one], label=name)
    axes.set(ylabel="RssAnon, MB", ylim=(0, None), title=f"{HD[0]}x{HD[1]} mono8 at {_RATE_HZ} frames/s")
    axes.legend(loc="upper right", ncols=len(samples))
    below.plot([seconds / 60 for seconds, _ in late_ms], [late for _, late in late_ms], ".", markersize=2)
    below.set(xlabel="minutes", ylabel="latency of a homography, ms", yscale="log")
    figure.savefig(path, dpi=110)


if __name__ == "__main__":
    keep_freed_memory()
    sys.exit(main())
