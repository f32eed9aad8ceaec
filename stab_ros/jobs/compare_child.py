"""One method over one input, in a separate process, so that its time and memory can be measured."""

from __future__ import annotations

import dataclasses
import time
import traceback
from collections.abc import Generator, Mapping
from dataclasses import dataclass
from functools import partial
from multiprocessing import get_context
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnProcess
from pathlib import Path
from signal import Signals
from types import TracebackType
from typing import TypeAlias

import numpy as np

from stab_ros.core.errors import StabRosError
from stab_ros.core.kernels import compile_kernels
from stab_ros.core.settings import Value
from stab_ros.core.text import one_line
from stab_ros.core.types import Frame, Image, Track
from stab_ros.io.source import Clock, Picture, open_source, read_again
from stab_ros.jobs.pipeline import PictureTracker, TrackedFrame
from stab_ros.parameters.engines import make_stabilizer

_STATUS = Path("/proc/self/status")
_NEXT = b"next"


@dataclass(frozen=True)
class Run:
    """The task of one process. values: checked parameters of the tracker."""

    source: Path
    values: Mapping[str, Value]
    image_topic: str | None = None
    limit: int | None = None
    fps: float | None = None
    clock: Clock = Clock.HEADER


@dataclass(frozen=True, eq=False)
class Step:
    """One frame of the input. number: from 0, undecodable frames included. track: without its covariance.

    seconds: for tracking and warping; None for an undecodable frame. steady: the frame warped to the reference; None
    while lost.
    """

    number: int
    track: Track
    seconds: float | None
    steady: Frame | None = None


@dataclass(frozen=True)
class Finished:
    """The end of the input. peak_mb: peak memory of the process (VmHWM), including libraries and decoding."""

    peak_mb: int


@dataclass(frozen=True)
class Failed:
    """The method failed. why: the reason, in one line."""

    why: str


Steps: TypeAlias = Generator[Step | Finished | Failed, None, None]


@dataclass(frozen=True, eq=False)
class _Pixels:
    """Format of the pixels that follow as raw bytes."""

    shape: tuple[int, ...]
    dtype: str
    encoding: str


def steps_of(run: Run) -> Steps:
    """Yields every frame as soon as it is done, then the end or the failure.

    The process starts on a frame when the caller asks for it, so nothing else runs while it is timed.
    """
    context = get_context("spawn")  # a forked process would count the memory of this one
    ours, theirs = context.Pipe()
    process = context.Process(target=_work, args=(theirs, run), daemon=True)
    process.start()
    theirs.close()
    try:
        yield from _received(ours, process)
    finally:
        ours.close()
        process.terminate()
        process.join()


def _received(connection: Connection, process: SpawnProcess) -> Steps:
    while True:
        item = _next_of(connection, process)
        yield item
        if not isinstance(item, Step):
            return
        connection.send_bytes(_NEXT)


def _next_of(connection: Connection, process: SpawnProcess) -> Step | Finished | Failed:
    item: Step | Finished | Failed
    try:
        item, pixels = connection.recv()
        if not isinstance(item, Step) or pixels is None:
            return item
        image: Image = np.empty(pixels.shape, pixels.dtype)
        connection.recv_bytes_into(image.data.cast("B"))
    except (EOFError, ConnectionError):
        process.join()
        return Failed(_ending(process.exitcode))
    return dataclasses.replace(item, steady=Frame(image, pixels.encoding, item.track.stamp_ns))


def _ending(code: int | None) -> str:
    if code is not None and code < 0:
        return f"its process was ended by {Signals(-code).name}"
    return f"its process ended with exit code {code}"


def _work(connection: Connection, run: Run) -> None:
    """Runs in the child process."""
    with _Reported(connection), open_source(run.source, run.image_topic, run.fps, run.clock) as source:
        camera = source.camera() if run.values.get("use_camera_info") else None
        again = partial(read_again, run.source, run.image_topic, run.fps, run.clock, run.limit)
        tracker = PictureTracker(make_stabilizer(run.values, camera), need_image=True, read_again=again)
        clock = _Clock(tracker)
        compile_kernels()  # found in the cache: the parent has compiled them
        for picture in source.frames(run.limit):
            _send(connection, *clock.step(picture))
            connection.recv_bytes()
        connection.send((Finished(peak_mb()), None))


class _Clock:
    """Times the steps of a tracker; divides the time of a step that answers later frames as well among them all."""

    def __init__(self, tracker: PictureTracker) -> None:
        self._tracker = tracker
        self._share_s = 0.0

    def step(self, picture: Picture) -> tuple[TrackedFrame, float]:
        """The tracked frame, and the seconds it took."""
        ahead, started_s = self._tracker.ahead, time.perf_counter()
        result = self._tracker.step(picture)
        elapsed_s = time.perf_counter() - started_s
        if self._tracker.ahead > ahead:
            self._share_s = elapsed_s = elapsed_s / (self._tracker.ahead + 1)
        elif ahead:
            elapsed_s += self._share_s
        return result, elapsed_s


def _send(connection: Connection, result: TrackedFrame, seconds: float) -> None:
    decoded, track = result.picture.decoded, dataclasses.replace(result.track, covariance=None)
    if not isinstance(decoded, Frame):
        connection.send((Step(result.number, track, None), None))
        return
    step = Step(result.number, track, seconds)
    if result.image is None or not track.tracked:
        connection.send((step, None))
        return
    image = np.ascontiguousarray(result.image)
    connection.send((step, _Pixels(image.shape, image.dtype.str, decoded.warped_encoding)))
    connection.send_bytes(image.data.cast("B"))


class _Reported:
    """Reports any exception to the parent, so that it ends only this method of the comparison."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection

    def __enter__(self) -> None:
        return None

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> bool:
        if isinstance(error, Exception) and not isinstance(error, BrokenPipeError):
            self._connection.send((Failed(_described(error, trace)), None))
        return isinstance(error, Exception)


def _described(error: Exception, trace: TracebackType | None) -> str:
    """The message of an error; for a bug also its location."""
    if isinstance(error, StabRosError):
        return one_line(error)
    last = traceback.extract_tb(trace)[-1]
    return one_line(f"{type(error).__name__}: {error} ({Path(last.filename).name}, line {last.lineno})")


def peak_mb() -> int:
    """Peak memory of this process so far, MB (2^20 bytes)."""
    lines = _STATUS.read_text(encoding="utf-8").splitlines()
    return round(next(int(line.split()[1]) for line in lines if line.startswith("VmHWM:")) / 1024)
