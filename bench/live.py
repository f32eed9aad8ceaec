"""The live tracker over real DDS: a camera, the tracker node and a follower, each a process."""

from __future__ import annotations

import json
import subprocess
import tempfile
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

from effort import Effort
from live_processes import ProcessSample, encoded, start_python, stopped, there_and_back, write_loop
from scenes import HD, UHD, Scene, render
from spread import Spread
from tables import Section, Table, number

SHARED_MEMORY = Path("/dev/shm") if Path("/dev/shm").is_dir() else None
_HERE = Path(__file__).resolve().parent
_DOMAIN, _LOOK_S = 72, 0.1
_SETTLING_S = 2.0  # at the beginning, while the start-up buffer is filled
_HEAD = ("stream", "rate, Hz", "sent", "homographies", "median, ms", "95 %", "max", "images", "median, ms", "95 %",
         "max", "first, s", "dropped at first", "CPU, ms", "MB")
_NOTE = ("Later than the first {:g} s, while the start-up buffer is filled. How late: from publication of the image to "
         "reception, in another process, of its homography and of the stabilised image. First: the same of the first "
         "image's homography, and how many images of those first seconds were dropped. CPU: of the tracker, per "
         "image. MB: its RssAnon after a tenth of the time and at the end.")


@dataclass(frozen=True)
class LiveCase:
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
    LiveCase(UHD, "mono8", 30.0, images=False),
    LiveCase(HD, "bgr8", 30.0, images=True),
    LiveCase(UHD, "mono8", 12.0, images=True),
    LiveCase(UHD, "mono8", 20.0, images=True),
    LiveCase(UHD, "mono8", 30.0, images=True),
    LiveCase(UHD, "mono8", 30.0, images=True, threads=1),
    LiveCase(UHD, "bgr8", 15.0, images=False),
)


@dataclass(frozen=True)
class LiveResult:
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
        result = _run(case, scenes[case.size], effort.live_s)
        rows.append(_row(case, result))
        data[f"{case.name}, {case.rate_hz:g} Hz"] = asdict(case) | _data(result)
    return Section("Live", [Table("Over DDS, three processes", _HEAD, rows, _NOTE.format(_SETTLING_S))], data)


def _run(case: LiveCase, scene: Scene, seconds: float) -> LiveResult:
    with tempfile.TemporaryDirectory(dir=SHARED_MEMORY) as folder:
        bag = Path(folder) / "loop.mcap"
        write_loop(bag, (encoded(frame, case.encoding) for frame in there_and_back(scene)))
        tracker = _start("-m", "stab_ros.nodes.tracker", "--ros-args", "-p", f"threads:={case.threads}",
                         "-p", "wait_for_subscribers:=1")
        follower = _start(str(_HERE / "one_follower.py"), str(int(case.images)))
        camera = _start(str(_HERE / "one_camera.py"), str(bag), str(case.rate_hz), str(round(seconds * case.rate_hz)))
        samples = _watched(tracker, camera)
        sent_ns = json.loads(camera.communicate()[0])
        time.sleep(1.0)
        said = [stopped(process) for process in (tracker, follower)][-1]
    return _result(sent_ns, json.loads(said), samples)


def _start(*arguments: str) -> subprocess.Popen[bytes]:
    return start_python(_DOMAIN, *arguments, stdout=subprocess.PIPE)


def _watched(tracker: subprocess.Popen[bytes], camera: subprocess.Popen[bytes]) -> list[ProcessSample]:
    """The tracker, until the camera has ended."""
    samples = []
    while camera.poll() is None:
        samples.append(ProcessSample.of(tracker.pid))
        time.sleep(_LOOK_S)
    return samples


def _result(sent_ns: list[int], said: Mapping[str, list[tuple[int, float]]],
            samples: list[ProcessSample]) -> LiveResult:
    begin_ns = sent_ns[0] + round(_SETTLING_S * 1e9)
    sent = [stamp for stamp in sent_ns if stamp >= begin_ns]
    begin, end = (min(samples, key=lambda sample: abs(sample.time_ns - stamp)) for stamp in (begin_ns, sent_ns[-1]))
    early = min(samples, key=lambda sample: abs(sample.time_ns - begin_ns - (sent_ns[-1] - begin_ns) / 10))
    homographies, images = ([late for stamp, late in said[what] if stamp >= begin_ns]
                            for what in ("homographies", "images"))
    first_s = said["homographies"][0][1] / 1e3
    dropped = len(sent_ns) - len(sent) - (len(said["homographies"]) - len(homographies))
    cpu_ms = 1e3 * (end.processor_s - begin.processor_s) / len(sent)
    return LiveResult(len(sent), homographies, images, first_s, dropped, cpu_ms, (early.anonymous_mb, end.anonymous_mb))


def _row(case: LiveCase, result: LiveResult) -> tuple[str, ...]:
    cells = [case.name, f"{case.rate_hz:g}", str(result.sent)]
    for late in (result.homographies, result.images):
        spread = Spread.of(late)
        cells += [str(spread.count), *(number(value, 1) for value in (spread.median, spread.p95, spread.max))]
    used_mb = " ".join(number(mb, 0) for mb in result.anonymous_mb)
    return (*cells, number(result.first_s, 2), str(result.dropped_at_first), number(result.cpu_ms, 1), used_mb)


def _data(result: LiveResult) -> dict[str, object]:
    told = {name: value for name, value in asdict(result).items() if name not in ("homographies", "images")}
    return told | {"homographies_ms": Spread.of(result.homographies).data(),
                   "images_ms": Spread.of(result.images).data()}
