"""`image_stabilized/compressed` over a link of 20 Mbit/s: how late pictures are at a viewer, and what the tracker does.

python bench/thin_link.py [--seconds 20] [--mbit-s 20] [--queue-kb 1000]    As root. Camera, tracker and a follower of
the homographies are on one host, the viewer is on another one.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from live_processes import stopped, there_and_back, write_loop
from scenes import HD, Scene, render
from spread import Spread
from two_hosts import narrow, two_hosts

VIEWERS = ("", "best_effort", "reliable")  # "": nobody views
_HERE = Path(__file__).resolve().parent
_DOMAIN = 73
_RATE_HZ = 30.0
_SETTLING_S = 2.0  # of the tracker, at the beginning


@dataclass(frozen=True)
class Link:
    """queue_bytes: what waits before the link at most; the rest is lost."""

    mbit_s: float
    queue_bytes: int


@dataclass(frozen=True)
class Seen:
    """What came of what was sent: stamps in ns, delays in ms, sizes in bytes."""

    sent: Sequence[int]
    homographies: Sequence[tuple[int, float]]
    pictures: Sequence[tuple[int, float, int]]


def watch(scene: Scene, link: Link, viewer: str, seconds: float, settings: Sequence[str] = ()) -> Seen:
    """A stream of 1080p at 30 Hz. viewer: its reliability, "" for none. settings: of the tracker, `name:=value`."""
    name = f"thin{os.getpid() % 10000}"
    with tempfile.TemporaryDirectory(dir="/dev/shm") as folder, two_hosts(name) as (here, there):
        narrow(name, link.mbit_s, link.queue_bytes)
        bag = Path(folder) / "loop.mcap"
        write_loop(bag, there_and_back(scene))
        words = [word for setting in settings for word in ("-p", setting)]
        tracker = _start(here, "-m", "stab_ros.nodes.tracker", "--ros-args", "-p", "wait_for_subscribers:=1", *words)
        others = [_start(here, str(_HERE / "one_follower.py"), "0")]
        if viewer:
            others.append(_start(there, str(_HERE / "one_viewer.py"), viewer))
        camera = _start(here, str(_HERE / "one_camera.py"), str(bag), str(_RATE_HZ), str(round(seconds * _RATE_HZ)))
        sent = json.loads(camera.communicate()[0])
        time.sleep(1.0)
        follower, *viewers = [json.loads(stopped(one)) for one in others]
        stopped(tracker)
    return Seen(sent, follower["homographies"], viewers[0] if viewers else [])


def _start(host: Sequence[str], *arguments: str) -> subprocess.Popen[bytes]:
    environment = {**os.environ, "ROS_DOMAIN_ID": str(_DOMAIN), "ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET"}
    return subprocess.Popen([*host, sys.executable, *arguments], env=environment, stdout=subprocess.PIPE)


def main(seconds: float, link: Link) -> None:
    """A row of a Markdown table for each kind of viewer."""
    scene = render("kolubara", HD, 5)
    print("| viewer | frames | answered | how late, ms | pictures | kB | how late, ms: thirds | the latest |")
    print("|---|---|---|---|---|---|---|---|")
    for viewer in VIEWERS:
        print(_row(viewer, watch(scene, link, viewer, seconds)), flush=True)


def _row(viewer: str, seen: Seen) -> str:
    """Of all that was sent once the stream was under way; delays are medians, those of pictures of each third."""
    begin_ns, end_ns = seen.sent[0] + round(_SETTLING_S * 1e9), seen.sent[-1]
    sent = [stamp_ns for stamp_ns in seen.sent if stamp_ns >= begin_ns]
    answers = [late_ms for stamp_ns, late_ms in seen.homographies if stamp_ns >= begin_ns]
    pictures = [one for one in seen.pictures if one[0] >= begin_ns]
    thirds = [[late_ms for stamp_ns, late_ms, _ in pictures if number <= 3 * (stamp_ns - begin_ns) / (end_ns - begin_ns)
               < number + 1] for number in range(3)]
    size_kb = Spread.of([size / 1e3 for *_, size in pictures])
    cells = (viewer or "none", len(sent), len(answers), f"{Spread.of(answers).median:.0f}", len(pictures),
             f"{size_kb.median:.0f}", ", ".join(f"{Spread.of(third).median:.0f}" for third in thirds),
             f"{Spread.of([late_ms for _, late_ms, _ in pictures]).max:.0f}")
    return f"| {' | '.join(map(str, cells))} |"


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--mbit-s", type=float, default=20.0)
    parser.add_argument("--queue-kb", type=int, default=1000)
    given = parser.parse_args()
    main(given.seconds, Link(given.mbit_s, 1000 * given.queue_kb))
