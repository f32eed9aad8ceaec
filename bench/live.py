"""The live tracker over real DDS: a camera, the tracker node and a follower, each a process."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

import cv2
from effort import Effort
from scenes import HD, UHD, Scene, render
from spread import Spread
from tables import Section, Table, number

from stab_ros.io.bag import BagWriter, topic_of
from stab_ros.io.messages import IMAGE, header_of, image_cdr

SHARED_MEMORY = Path("/dev/shm") if Path("/dev/shm").is_dir() else None
_HERE = Path(__file__).resolve().parent
_DOMAIN, _LOOK_S = 72, 0.1
_SETTLING_S = 2.0  # at the beginning, while answers are deferred
_HEAD = ("stream", "rate, Hz", "sent", "homographies", "median, ms", "95 %", "max", "images", "median, ms", "95 %",
         "max", "first, s", "dropped at first", "CPU, ms", "MB")
_NOTE = ("Later than the first {:g} s, in which answers are deferred. How late: from publication of the picture to "
         "reception, in another process, of its homography and of the stabilised picture. First: the same of the first "
         "picture's homography, and how many pictures of those first seconds were dropped. CPU: of the tracker, per "
         "picture. MB: its RssAnon after a tenth of the time and at the end.")


@dataclass(frozen=True)
class Case:
    """One stream. images: image_stabilized is subscribed too. threads: of the tracker; 0: its own choice."""

    size: tuple[int, int]
    encoding: str
    rate_hz: float
    images: bool
    threads: int = 0

    @property
    def name(self) -> str:
        told = f"{self.size[0]}x{self.size[1]} {self.encoding}" + (", images" if self.images else "")
        return told + (f", threads {self.threads}" if self.threads else "")


_CASES = (
    Case(UHD, "mono8", 30.0, images=False),
    Case(HD, "bgr8", 30.0, images=True),
    Case(UHD, "mono8", 12.0, images=True),
    Case(UHD, "mono8", 20.0, images=True),
    Case(UHD, "mono8", 30.0, images=True),
    Case(UHD, "mono8", 30.0, images=True, threads=1),
    Case(UHD, "bgr8", 15.0, images=False),
)


@dataclass(frozen=True)
class Sample:
    """A process at a time: its processor time so far, and RssAnon."""

    time_ns: int
    processor_s: float
    anonymous_mb: float

    @staticmethod
    def of(pid: int) -> Sample:
        folder = Path("/proc") / str(pid)
        ticks = sum(map(int, (folder / "stat").read_text(encoding="utf-8").rpartition(")")[2].split()[11:13]))
        status = (folder / "status").read_text(encoding="utf-8").partition("RssAnon:")[2].split()
        return Sample(time.time_ns(), ticks / os.sysconf("SC_CLK_TCK"), int(status[0]) / 1024)


@dataclass(frozen=True)
class Outcome:
    """What came, of what was sent once the stream was under way; how late, ms; the tracker's effort."""

    sent: int
    homographies: list[float]
    images: list[float]
    first_s: float
    dropped_at_first: int
    cpu_ms: float
    anonymous_mb: tuple[float, float]


def measure(effort: Effort) -> Section:
    """All cases, one after the other."""
    rows, data = [], {}
    scenes = {size: render("kolubara", size, effort.looped) for size in (HD, UHD)}
    for case in _CASES:
        outcome = _run(case, scenes[case.size], effort.live_s)
        rows.append(_row(case, outcome))
        data[f"{case.name}, {case.rate_hz:g} Hz"] = asdict(case) | _data(outcome)
    return Section("Live", [Table("Over DDS, three processes", _HEAD, rows, _NOTE.format(_SETTLING_S))], data)


def _run(case: Case, scene: Scene, seconds: float) -> Outcome:
    with tempfile.TemporaryDirectory(dir=SHARED_MEMORY) as folder:
        bag = Path(folder) / "loop.mcap"
        _write_loop(bag, scene, case.encoding)
        tracker = _start("-m", "stab_ros.nodes.tracker", "--ros-args", "-p", f"threads:={case.threads}",
                         "-p", "wait_for_subscribers:=1")
        follower = _start(str(_HERE / "one_follower.py"), str(int(case.images)))
        camera = _start(str(_HERE / "one_camera.py"), str(bag), str(case.rate_hz), str(round(seconds * case.rate_hz)))
        samples = _watched(tracker, camera)
        sent_ns = json.loads(camera.communicate()[0])
        time.sleep(1.0)
        said = [_stopped(process) for process in (tracker, follower)][-1]
    return _outcome(sent_ns, json.loads(said), samples)


def _write_loop(path: Path, scene: Scene, encoding: str) -> None:
    """There and back, so that its end meets its beginning."""
    with BagWriter(path) as writer:
        writer.add_topic(topic_of("image_raw", IMAGE))
        for frame, _ in scene.back_and_forth(2 * (len(scene.frames) - 1)):
            image = frame.image if encoding == "mono8" else cv2.cvtColor(frame.image, cv2.COLOR_GRAY2BGR)
            cdr = image_cdr(image, encoding, header_of(frame))
            writer.write("image_raw", frame.stamp_ns, frame.stamp_ns, cdr)


def _start(*words: str) -> subprocess.Popen[bytes]:
    environment = {**os.environ, "ROS_DOMAIN_ID": str(_DOMAIN), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    return subprocess.Popen([sys.executable, *words], env=environment, stdout=subprocess.PIPE)


def _stopped(process: subprocess.Popen[bytes]) -> bytes:
    process.send_signal(signal.SIGINT)
    return process.communicate()[0]


def _watched(tracker: subprocess.Popen[bytes], camera: subprocess.Popen[bytes]) -> list[Sample]:
    """The tracker, until the camera has ended."""
    samples = []
    while camera.poll() is None:
        samples.append(Sample.of(tracker.pid))
        time.sleep(_LOOK_S)
    return samples


def _outcome(sent_ns: list[int], said: Mapping[str, list[tuple[int, float]]], samples: list[Sample]) -> Outcome:
    begin_ns = sent_ns[0] + round(_SETTLING_S * 1e9)
    sent = [stamp for stamp in sent_ns if stamp >= begin_ns]
    begin, end = (min(samples, key=lambda sample: abs(sample.time_ns - stamp)) for stamp in (begin_ns, sent_ns[-1]))
    early = min(samples, key=lambda sample: abs(sample.time_ns - begin_ns - (sent_ns[-1] - begin_ns) / 10))
    homographies, images = ([late for stamp, late in said[what] if stamp >= begin_ns]
                            for what in ("homographies", "images"))
    first_s = said["homographies"][0][1] / 1e3
    dropped = len(sent_ns) - len(sent) - (len(said["homographies"]) - len(homographies))
    cpu_ms = 1e3 * (end.processor_s - begin.processor_s) / len(sent)
    return Outcome(len(sent), homographies, images, first_s, dropped, cpu_ms, (early.anonymous_mb, end.anonymous_mb))


def _row(case: Case, outcome: Outcome) -> tuple[str, ...]:
    cells = [case.name, f"{case.rate_hz:g}", str(outcome.sent)]
    for late in (outcome.homographies, outcome.images):
        spread = Spread.of(late)
        cells += [str(spread.count), *(number(value, 1) for value in (spread.median, spread.p95, spread.max))]
    used_mb = " ".join(number(mb, 0) for mb in outcome.anonymous_mb)
    return (*cells, number(outcome.first_s, 2), str(outcome.dropped_at_first), number(outcome.cpu_ms, 1), used_mb)


def _data(outcome: Outcome) -> dict[str, object]:
    told = {name: value for name, value in asdict(outcome).items() if name not in ("homographies", "images")}
    return told | {"homographies_ms": Spread.of(outcome.homographies).data(),
                   "images_ms": Spread.of(outcome.images).data()}
