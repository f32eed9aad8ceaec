"""What the live tracker answers at the start of a stream under bad conditions, beside the engine and the truth.

    python bench/starts.py [--only NAME,NAME] [--json FILE]

Each row is a flight over water that looks like ground, 960x540 mono8, header stamps 40 ms apart however it is paced.
A camera and the tracker are processes of their own, on a DDS domain that nobody else is on; every frame is kept. Prints
Markdown; nothing passes or fails.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from threading import Thread

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from live import SHARED_MEMORY
from machine import describe
from rclpy.node import Node
from scenes import SEED
from sensor_msgs.msg import CameraInfo, Image
from static_ground import trap
from tables import Table, number
from tqdm import tqdm

import stab_ros
from stab_ros.core.geometry import rms_distance
from stab_ros.core.types import Frame, Homography
from stab_ros.io.bag import BagWriter, open_bag, topic_of
from stab_ros.io.cdr import IMAGE, SECOND_NS, Header, read_stamp
from stab_ros.io.diagnostics_message import read_values
from stab_ros.io.homography_message import read_homography
from stab_ros.io.image_message import image_cdr, read_image
from stab_ros.nodes.qos import KEEP_ALL
from stab_ros.nodes.transport import use_profile
from stab_ros.parameters.engines import make_stabilizer
from stab_ros.synthetic.flight import Flight, preset

SIZE, FRAMES, SPEED_M_S, RATE_HZ = (960, 540), 75, 1.0, 25.0
_DOMAIN = 101  # beyond those of the tests
_HALT_AFTER, _HALT_S = 8, 5.0
_PATIENCE_S = 120.0  # more than the stream itself takes
_LAST_WORDS_S = 1.3  # a report comes once a second
_NOWHERE = "/proc/1/nowhere"  # cannot be made, by root neither
_PLAIN = re.compile(r"tracked|lost|waiting for .*|no image for .*")  # what it says of its state anyway
_HEAD = ("start", "answered", "TRACKED", "LOST", "median, px", "worst, px", "from the engine's", "sigma, px",
         "ready, s", "said")
_NOTE = ("Median and worst: RMS distance to the truth over a 9x9 grid, without the reference. From the engine's: the "
         "largest difference of an entry of a homography from what the engine makes of the same frames, those that "
         "either lost left out. Sigma: the median. Ready: from the start of the process until it says so. Said: "
         "remarks on /diagnostics.")


# the conditions -------------------------------------------------------------------------------------------------------
@dataclass(frozen=True)
class Condition:
    """How the first frames come, and to whom.

    step_s: from frame to frame. pause: after so many frames so many seconds more. halted: `tracker` or `camera` is
    stopped for a while in the start. cache: the tracker's compiled kernels are there (warm), yet to be made (cold), or
    cannot be kept (none). busy: whether all cores have other work. through: what starts the tracker.
    """

    frames: int = FRAMES
    step_s: float = 1 / RATE_HZ
    pause: tuple[int, float] = (0, 0.0)
    halted: str = ""
    cache: str = "warm"
    busy: bool = False
    through: tuple[str, ...] = ()

    def due_ns(self, index: int) -> int:
        """When a frame is to be published, after the first."""
        after, pause_s = self.pause
        return round(SECOND_NS * (index * self.step_s + (pause_s if index >= after else 0.0)))


CONDITIONS: Mapping[str, Condition] = {
    "warm": Condition(),
    "cold": Condition(cache="cold"),
    "no-cache": Condition(cache="none"),
    "slow": Condition(frames=40, step_s=2.6),
    "tenth": Condition(frames=40, step_s=0.4),
    "pause": Condition(frames=45, pause=(1, 6.0)),
    "stop-tracker": Condition(halted="tracker"),
    "stop-player": Condition(halted="camera"),
    "loaded": Condition(busy=True),
    "one-core": Condition(through=("taskset", "-c", "0")),
    "long-pause": Condition(pause=(8, 30.0)),
}


# what is flown --------------------------------------------------------------------------------------------------------
@dataclass(frozen=True)
class StartAnswer:
    """To one frame. H: None while lost."""

    H: Homography | None
    sigma_px: float


@dataclass(frozen=True, eq=False)
class StartStream:
    """pictures: serialised. truth, engine: by header stamp, ns; the latter is what the engine answers."""

    pictures: list[bytes]
    truth: dict[int, Homography]
    engine: dict[int, StartAnswer]

    @staticmethod
    def of(flight: Flight) -> StartStream:
        """Also compiles the kernels, if they are not yet: the frames are as a node gets them."""
        pictures, truth = [], {}
        for shot in tqdm(flight, "render", disable=None, leave=False):
            pictures.append(image_cdr(shot.image, "mono8", Header(shot.stamp_ns)))
            truth[shot.stamp_ns] = shot.ref_H_cur
        return StartStream(pictures, truth, _by_engine([read_image(one, IMAGE) for one in pictures]))

    def write(self, path: Path, condition: Condition) -> None:
        """A bag whose log times are when each picture is due; the stamps are as they were."""
        with BagWriter(path) as writer:
            writer.add_topic(topic_of("image_raw", IMAGE))
            for index, cdr in enumerate(self.pictures[: condition.frames]):
                writer.write("image_raw", condition.due_ns(index), read_stamp(cdr), cdr)


def trap_flight() -> Flight:
    """The water flows as fast as in the fastest of `static_ground`."""
    scene = trap("kolubara", SPEED_M_S, preset("kolubara").motion.drift_per_s)
    return Flight(replace(scene, fps=RATE_HZ), SIZE, FRAMES, SEED)


def _by_engine(frames: Sequence[Frame]) -> dict[int, StartAnswer]:
    stabilizer = make_stabilizer({})
    tracks = [track for frame in frames for track in stabilizer.answers(frame)] + stabilizer.finish()
    return {track.stamp_ns: StartAnswer(track.ref_H_cur, _sigma(track.sigma_px)) for track in tracks}


def _sigma(told: float | str | None) -> float:
    return float(told) if told not in (None, "") else math.nan


# the processes --------------------------------------------------------------------------------------------------------
def play(path: Path) -> None:
    """What the camera's process does: says when it has published each picture, ns; stays until stdin ends."""
    with open_bag(path) as bag:
        messages = list(bag.messages())
    images = rclpy.create_node("camera", namespace="/start").create_publisher(Image, "image_raw", KEEP_ALL)
    while not images.get_subscription_count():
        time.sleep(0.01)
    start_ns = time.monotonic_ns()
    for message in messages:
        time.sleep(max(0, start_ns + message.log_time_ns - time.monotonic_ns()) / SECOND_NS)
        images.publish(message.data)
        print(time.time_ns(), flush=True)
    sys.stdin.read()


def _tracker(condition: Condition, folder: Path) -> tuple[list[str], dict[str, str]]:
    """Command line and environment."""
    words = [*condition.through, sys.executable, "-m", "stab_ros.nodes.tracker", "--ros-args", "-r", "__ns:=/start",
             "-p", "queue_depth:=0", "-p", "wait_for_subscribers:=1"]
    if condition.cache == "cold":
        return words, {"NUMBA_CACHE_DIR": str(folder / "cache")}
    if condition.cache == "none":
        nowhere = dict.fromkeys(("NUMBA_CACHE_DIR", "HOME", "XDG_CACHE_HOME"), _NOWHERE)
        return words, {**nowhere, "ROS_LOG_DIR": str(folder), "PYTHONPATH": str(_uncached_package(folder)),
                       "PYTHONSAFEPATH": "1"}  # or `-m` would look into this folder first
    return words, {}


def _uncached_package(folder: Path) -> Path:
    """Where a copy of our package is in which no kernel can be cached, as where it cannot be written."""
    package = folder / "package" / "stab_ros"
    shutil.copytree(Path(stab_ros.__file__).parent, package, ignore=shutil.ignore_patterns("__pycache__"))
    for place in {file.parent for file in package.rglob("*.py")}:
        (place / "__pycache__").touch()  # no folder, and none can be made: root may write anywhere else
    return package.parent


@contextmanager
def _running(words: Sequence[str], environment: Mapping[str, str], output: Path) -> Iterator[subprocess.Popen[bytes]]:
    """Ended by SIGINT, or the hard way; stdin is open until then."""
    with output.open("wb") as log:
        process = subprocess.Popen(words, env={**os.environ, **environment}, stdin=subprocess.PIPE, stdout=log,
                                   stderr=subprocess.STDOUT)
    try:
        yield process
    finally:
        process.send_signal(signal.SIGCONT)
        process.send_signal(signal.SIGINT)
        try:
            process.communicate(timeout=20)
        except subprocess.TimeoutExpired:
            process.kill()
            process.communicate()


@contextmanager
def _other_work(busy: bool) -> Iterator[None]:
    """For every core, if `busy`."""
    with ExitStack() as processes:
        for _ in range((os.cpu_count() or 1) * busy):
            words = [sys.executable, "-c", "while True: pass"]
            processes.enter_context(_running(words, {}, Path(os.devnull)))
        yield


def _halt(process: subprocess.Popen[bytes] | None, published: Path) -> None:
    """Stops a process for a while, once the camera has published so many frames; in a thread of its own."""

    def work(halted: subprocess.Popen[bytes]) -> None:
        while published.read_bytes().count(b"\n") < _HALT_AFTER:
            time.sleep(0.005)
        halted.send_signal(signal.SIGSTOP)
        time.sleep(_HALT_S)
        halted.send_signal(signal.SIGCONT)

    if process is not None:
        Thread(target=work, args=(process,), daemon=True).start()


# what is heard --------------------------------------------------------------------------------------------------------
@dataclass(frozen=True, eq=False)
class Heard:
    """All that the tracker said, serialised; remarks: of its reports, by what they are without their numbers."""

    homographies: list[bytes] = field(default_factory=list)
    tracks: list[bytes] = field(default_factory=list)
    remarks: dict[str, str] = field(default_factory=dict)

    def listen(self, node: Node) -> None:
        for msg_class, topic, into in ((CameraInfo, "homography", self.homographies),
                                       (DiagnosticArray, "tracker_node/track", self.tracks)):
            node.create_subscription(msg_class, f"/start/{topic}", into.append, KEEP_ALL, raw=True)
        node.create_subscription(DiagnosticArray, "/diagnostics", self._on_report, KEEP_ALL)

    def _on_report(self, report: DiagnosticArray) -> None:
        """The state comes first in a message, then what the tracker has to remark; of each kind the first is kept."""
        for status in report.status:
            for remark in status.message.split("; "):
                if not _PLAIN.fullmatch(remark):
                    self.remarks.setdefault(re.sub(r"[\d.]+", "", remark), remark)

    def answers(self) -> dict[int, StartAnswer]:
        """By stamp, the first to each."""
        sigmas = {read_stamp(cdr): _sigma(read_values(cdr)["sigma_px"]) for cdr in self.tracks}
        found: dict[int, StartAnswer] = {}
        for stamp_ns, H in map(read_homography, self.homographies):
            found.setdefault(stamp_ns, StartAnswer(H, sigmas.get(stamp_ns, math.nan)))
        return found

    def states(self) -> list[str]:
        return [read_values(cdr)["state"] for cdr in self.tracks]


def fly(condition: Condition, stream: StartStream, folder: Path, node: Node) -> tuple[Heard, str, float]:
    """What is heard of a tracker under this condition, its log, and when it was started, s."""
    heard, bag, log, said = Heard(), folder / "stream.mcap", folder / "tracker.log", folder / "camera.log"
    stream.write(bag, condition)
    heard.listen(node)
    with _other_work(condition.busy), _running([sys.executable, __file__, "--play", str(bag)], {}, said) as camera:
        _spin(node, lambda: node.count_publishers("/start/image_raw") > 0, _PATIENCE_S)
        start_s = time.time()
        with _running(*_tracker(condition, folder), log) as tracker:
            _halt({"tracker": tracker, "camera": camera}.get(condition.halted), said)
            _attend(condition, heard, tracker, node)
        _spin(node, lambda: False, _LAST_WORDS_S)  # what it may have answered at its end
    return heard, log.read_text(encoding="utf-8", errors="replace"), start_s


def _attend(condition: Condition, heard: Heard, tracker: subprocess.Popen[bytes], node: Node) -> None:
    """Listens until every frame is answered, or it is hopeless, and for the report after that."""
    limit_s = condition.due_ns(condition.frames) / SECOND_NS + _PATIENCE_S
    _spin(node, lambda: len(heard.tracks) >= condition.frames or tracker.poll() is not None, limit_s)
    _spin(node, lambda: False, _LAST_WORDS_S)


def _spin(node: Node, done: Callable[[], bool], limit_s: float) -> None:
    """Listens until something has come about, or no longer."""
    deadline_s = time.monotonic() + limit_s
    while not done() and time.monotonic() < deadline_s:
        rclpy.spin_once(node, timeout_sec=0.02)


# what came of it ------------------------------------------------------------------------------------------------------
@dataclass(frozen=True, eq=False)
class StartResult:
    """error_px: of every frame but the reference that was found. apart: from the engine's homographies."""

    frames: int
    answered: int
    tracked: int
    lost: int
    error_px: list[float]
    apart: float
    sigma_px: float
    ready_s: float = math.nan
    remarks: tuple[str, ...] = ()

    @staticmethod
    def of(answers: Mapping[int, StartAnswer], stream: StartStream, frames: int, states: Sequence[str]) -> StartResult:
        found = {stamp_ns: one.H for stamp_ns, one in sorted(answers.items()) if one.H is not None}
        reference_ns = next(iter(stream.truth))
        error_px = [rms_distance(H, stream.truth[stamp_ns], SIZE) for stamp_ns, H in found.items()
                    if stamp_ns != reference_ns]
        same = {stamp_ns: stream.engine[stamp_ns].H for stamp_ns in found}
        apart = [float(np.abs(found[stamp_ns] - H).max()) for stamp_ns, H in same.items() if H is not None]
        sigmas = [one.sigma_px for one in answers.values() if math.isfinite(one.sigma_px)]
        return StartResult(frames, len(answers), states.count("TRACKED"), states.count("LOST"), error_px,
                       max(apart, default=math.nan), float(np.median(sigmas)) if sigmas else math.nan)

    @property
    def median_px(self) -> float:
        return float(np.median(self.error_px)) if self.error_px else math.nan

    @property
    def worst_px(self) -> float:
        return max(self.error_px, default=math.nan)

    def row(self, name: str) -> tuple[str, ...]:
        apart = f"{self.apart:.1e}" if math.isfinite(self.apart) else "-"
        said = "; ".join(_short(remark) for remark in self.remarks)
        return (name, f"{self.answered}/{self.frames}", str(self.tracked), str(self.lost), number(self.median_px, 4),
                number(self.worst_px, 4), apart, number(self.sigma_px, 4), number(self.ready_s, 1), said)

    def data(self) -> dict[str, object]:
        """For the JSON file, which knows no NaN."""
        told = asdict(self) | {"median_px": self.median_px, "worst_px": self.worst_px}
        return {name: None if isinstance(value, float) and math.isnan(value) else value
                for name, value in told.items()}


def _short(remark: str) -> str:
    return (remark if len(remark) <= 48 else f"{remark[:45]}...").replace("|", "/")


def _ready_s(log: str, start_s: float) -> float:
    """When the tracker said that it is ready, by the time in its log."""
    found = re.search(r"\[(\d+\.\d+)\] \[[\w./]+\]: ready", log)
    return float(found[1]) - start_s if found else math.nan


def measure(names: Sequence[str]) -> dict[str, StartResult]:
    """One after the other; first what the engine answers."""
    stream = StartStream.of(trap_flight())
    states = ["LOST" if one.H is None else "TRACKED" for one in stream.engine.values()]
    found = {"engine": StartResult.of(stream.engine, stream, FRAMES, states)}
    if any(CONDITIONS[name].cache == "warm" for name in names):
        _measure(Condition(), stream)  # so that whatever it compiles is there
    return found | {name: _measure(CONDITIONS[name], stream) for name in tqdm(names, "starts", disable=None)}


def _measure(condition: Condition, stream: StartStream) -> StartResult:
    node = rclpy.create_node("listener")
    with tempfile.TemporaryDirectory(dir=SHARED_MEMORY) as folder:
        heard, log, start_s = fly(condition, stream, Path(folder), node)
    node.destroy_node()
    outcome, ready_s = StartResult.of(heard.answers(), stream, condition.frames, heard.states()), _ready_s(log, start_s)
    if math.isnan(ready_s):
        print(f"never ready:\n{log}", file=sys.stderr)
    return replace(outcome, ready_s=ready_s, remarks=tuple(heard.remarks.values()))


def main(arguments: Sequence[str] | None = None) -> None:
    """Measures, and says what came of it; or is the camera."""
    options = _parser().parse_args(arguments)
    os.environ |= {"ROS_DOMAIN_ID": str(options.domain), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    use_profile()
    rclpy.init()
    if options.play is None:
        _report(measure(options.only), options.json)
    else:
        play(options.play)
    rclpy.shutdown()


def _report(found: Mapping[str, StartResult], path: Path | None) -> None:
    title = f"Starts: {SIZE[0]}x{SIZE[1]} mono8, water that looks like ground at {SPEED_M_S:g} m/s"
    print(Table(title, _HEAD, [one.row(name) for name, one in found.items()], _NOTE).text())
    if path is not None:
        told = {"machine": describe(), "starts": {name: one.data() for name, one in found.items()}}
        path.write_text(json.dumps(told, indent=1) + "\n", encoding="utf-8")


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description="The start of a stream under bad conditions.")
    parser.add_argument("--only", type=_names, default=list(CONDITIONS), metavar="NAME,NAME",
                        help=f"these alone: {', '.join(CONDITIONS)}")
    parser.add_argument("--json", type=Path, metavar="FILE", help="where to write all figures as JSON")
    parser.add_argument("--domain", type=int, default=_DOMAIN, help="ROS_DOMAIN_ID")
    parser.add_argument("--play", type=Path, help=argparse.SUPPRESS)
    return parser


def _names(text: str) -> list[str]:
    unknown = set(text.split(",")) - set(CONDITIONS)
    if unknown:
        raise argparse.ArgumentTypeError(f"{', '.join(sorted(unknown))} must be some of {', '.join(CONDITIONS)}")
    return text.split(",")


if __name__ == "__main__":
    main()
