"""Whether two checkouts give the same results, byte for byte: `python bench/same.py BEFORE AFTER WORK`.

Eight flights through the command and four through the live nodes, each with another method or reference strategy.
Offline the table of homographies, the messages of the bag and the evaluation's JSON and CSV are compared, live each
homography.
WORK keeps what was computed: a checkout whose results are there already is not run again.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import signal
import subprocess
import sys
import time
from dataclasses import dataclass, replace
from pathlib import Path

import cv2

from stab_ros.io.bag import open_bag

ROOT = Path(__file__).resolve().parent.parent
SAMPLE, DATA = ROOT / "bags/sample.mcap", ROOT.parent / "shared/data"
_DOMAIN = "229"
_QUIET_S = 3.0
_AWAY_M = 12.0  # from the first view


@dataclass(frozen=True)
class Flight:
    """What is tracked (made here if it names none) and with which parameters."""

    name: str
    recording: str
    parameters: tuple[str, ...]
    options: tuple[str, ...] = ()


OFFLINE = (
    Flight("direct_fixed", str(SAMPLE), ()),
    Flight("klt_updated", str(SAMPLE), ("method:=klt", "reference:=updated", "update_every:=4")),
    Flight("sift_adjacent", str(SAMPLE), ("method:=sift", "reference:=adjacent", "estimator:=ed_ransac")),
    Flight("fft_keyframe", str(SAMPLE), ("method:=fft", "reference:=keyframe", "model:=similarity")),
    Flight("traverse", "traverse", ("reference:=keyframe", "max_keyframes:=4", "start_s:=0")),
    Flight("trap", "trap", ()),
    Flight("gusts", str(DATA / "gusts/frames"), (), ("--fps", "24")),
    Flight("navizence", str(DATA / "navizence.mp4"), ("reference:=updated", "update_every:=20"), ("--limit", "50")),
)
LIVE = (
    Flight("live_direct_fixed", str(SAMPLE), ()),
    Flight("live_klt_updated", str(SAMPLE), ("method:=klt", "reference:=updated", "update_every:=4")),
    Flight("live_direct_adjacent", str(SAMPLE), ("reference:=adjacent", "start_s:=0.0")),
    Flight("live_sift_keyframe", str(SAMPLE), ("method:=sift", "reference:=keyframe")),
)


def main() -> int:
    """Compares, and prints a line for each result."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("before", type=Path)
    parser.add_argument("after", type=Path)
    parser.add_argument("work", type=Path)
    job = parser.parse_args()
    job.work.mkdir(parents=True, exist_ok=True)
    found = {side: _results(checkout.resolve(), job.work.resolve(), side)
             for side, checkout in (("before", job.before), ("after", job.after))}
    before, after = found["before"], found["after"]
    for name in sorted(before | after):
        print(f"{'same' if before.get(name) == after.get(name) else 'DIFFERENT':9}  {name}")
    return int(before != after)


def _results(checkout: Path, work: Path, side: str) -> dict[str, str]:
    """The hash of each result of a checkout."""
    out = work / side
    out.mkdir(exist_ok=True)
    found: dict[str, str] = {}
    for flight in OFFLINE:
        if not _input(flight, work).exists():
            continue
        bag = out / f"{flight.name}.mcap"
        if not bag.exists():
            _stabilize(checkout, replace(flight, recording=str(_input(flight, work))), bag)
        tables = [path for path in sorted(out.glob(f"{flight.name}.*")) if path != bag]
        found |= {path.name: _hash(path.read_bytes().replace(str(out).encode(), b"")) for path in tables}
        found[bag.name] = _hash(_messages(bag, with_times=True))
    for flight in LIVE:
        bag = out / f"{flight.name}.mcap"
        if not bag.exists():
            _fly_live(checkout, flight, bag)
        found[bag.name] = _hash(_messages(bag, with_times=False))
    return found


def _input(flight: Flight, work: Path) -> Path:
    if flight.recording not in {"traverse", "trap"}:
        return Path(flight.recording)
    folder = work / flight.recording
    if not folder.exists():
        _render(flight.recording, folder)
    return folder


def _render(name: str, folder: Path) -> None:
    """Three picture widths along the river, or water that is as rigid as ground."""
    sys.path.insert(0, str(ROOT / "test" / "helpers"))
    from flights import SIZE, moved, trap

    from stab_ros.synthetic.camera_path import Gust, Pose
    from stab_ros.synthetic.flight import Flight as Rendered
    from stab_ros.synthetic.flight import preset

    along = moved(preset("kolubara"), Gust(1.0, 2.2, Pose(x_m=_AWAY_M)))
    scene = along if name == "traverse" else trap("kolubara", 0.4, 0.4)
    folder.mkdir()
    for shot in Rendered(scene, size=SIZE, frames=80, seed=3):
        cv2.imwrite(str(folder / f"{shot.index:04}.png"), shot.image)


def _stabilize(checkout: Path, flight: Flight, bag: Path) -> None:
    chosen = [word for parameter in flight.parameters for word in ("-p", parameter)]
    _stab_ros(checkout, "stabilize", flight.recording, str(bag), "--homographies", str(bag.with_suffix(".H.csv")),
              *flight.options, *chosen)
    _stab_ros(checkout, "evaluate", str(bag), "--json", str(bag.with_suffix(".json")),
              "--csv", str(bag.with_suffix(".csv")))


def _environment(checkout: Path) -> dict[str, str]:
    return {**os.environ, "PYTHONPATH": str(checkout), "ROS_DOMAIN_ID": _DOMAIN,
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}


def _stab_ros(checkout: Path, *words: str) -> None:
    subprocess.run([sys.executable, "-m", "stab_ros", *words], env=_environment(checkout), cwd=checkout, check=True,
                   stdout=subprocess.DEVNULL)


def _node(checkout: Path, name: str, *parameters: str) -> subprocess.Popen[bytes]:
    chosen = [word for parameter in parameters for word in ("-p", parameter)]
    return subprocess.Popen([sys.executable, "-m", f"stab_ros.nodes.{name}", "--ros-args", "-r",
                             "tracker_node:__ns:=/camera", *chosen], env=_environment(checkout), cwd=checkout,
                            stderr=subprocess.DEVNULL)


def _fly_live(checkout: Path, flight: Flight, bag: Path) -> None:
    recorder = _node(checkout, "bag_recorder", f"output:={bag}", "topics:=[/camera/homography]")
    tracker = _node(checkout, "tracker", "queue_depth:=0", "image_transport:=compressed", "wait_for_subscribers:=1",
                    *flight.parameters)
    player = _node(checkout, "bag_player", f"bag:={flight.recording}", "wait_for_subscribers:=1")
    player.wait()
    _wait_until_idle(tracker.pid)
    for process in (tracker, recorder):
        process.send_signal(signal.SIGINT)
        process.wait()


def _wait_until_idle(pid: int) -> None:
    """Until the process has used hardly any CPU for a while."""
    before = -100
    while (ticks := _cpu_ticks(pid)) > before + 20:
        before = ticks
        time.sleep(_QUIET_S)


def _cpu_ticks(pid: int) -> int:
    fields = Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rsplit(")", 1)[1].split()
    return int(fields[11]) + int(fields[12])


def _messages(bag: Path, with_times: bool) -> bytes:
    """All messages of a bag; not its chunks, which a clock closes. with_times: and when they were logged."""
    found = bytearray()
    with open_bag(bag) as reader:
        for message in reader.messages():
            head = f"{message.topic} {message.log_time_ns}" if with_times else message.topic
            found += head.encode() + hashlib.sha256(message.data).digest()
    return bytes(found)


def _hash(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


if __name__ == "__main__":
    sys.exit(main())
