"""One method over one input, alone in a process of its own, so that its time and its memory are its own."""

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
from stab_ros.io.source import Picture, open_source, read_again
from stab_ros.jobs.pipeline import PictureTracker, TrackedFrame
from stab_ros.parameters.engines import make_stabilizer

_STATUS = Path("/proc/self/status")
_NEXT = b"next"


@dataclass(frozen=True)
class Run:
    """What one process has to do; `values` as `checked_values` gives them."""

    source: Path
    values: Mapping[str, Value]
    image_topic: str | None = None
    limit: int | None = None
    fps: float | None = None


@dataclass(frozen=True, eq=False)
class Step:
    """One frame of the input. number: from 0, undecodable ones included. track: without its covariance.

    seconds: of tracking and warping together; None where there was no picture. steady: the picture in the reference's
    place, None while lost.
    """

    number: int
    track: Track
    seconds: float | None
    steady: Frame | None = None


@dataclass(frozen=True)
class Finished:
    """The last frame is done. peak_mb: the most memory the process has held (VmHWM), with libraries and decoding."""

    peak_mb: int


@dataclass(frozen=True)
class Failed:
    """The method came to no end; why, in one line."""

    why: str


Steps: TypeAlias = Generator[Step | Finished | Failed, None, None]


@dataclass(frozen=True, eq=False)
class _Pixels:
    """They follow as they are."""

    shape: tuple[int, ...]
    dtype: str
    encoding: str


def steps_of(run: Run) -> Steps:
    """Every frame as it is done, then how it ended.

    The process works on the next frame only once it is asked for, so nothing else runs while it is timed.
    """
    context = get_context("spawn")  # a forked one would count our memory as its own
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
        told = _next_of(connection, process)
        yield told
        if not isinstance(told, Step):
            return
        connection.send_bytes(_NEXT)


def _next_of(connection: Connection, process: SpawnProcess) -> Step | Finished | Failed:
    told: Step | Finished | Failed
    try:
        told, pixels = connection.recv()
        if not isinstance(told, Step) or pixels is None:
            return told
        image: Image = np.empty(pixels.shape, pixels.dtype)
        connection.recv_bytes_into(image.data.cast("B"))
    except (EOFError, ConnectionError):
        process.join()
        return Failed(_ending(process.exitcode))
    return dataclasses.replace(told, steady=Frame(image, pixels.encoding, told.track.stamp_ns))


def _ending(code: int | None) -> str:
    if code is not None and code < 0:
        return f"its process was ended by {Signals(-code).name}"
    return f"its process ended with exit code {code}"


def _work(connection: Connection, run: Run) -> None:
    """What the child does."""
    with _Reported(connection), open_source(run.source, run.image_topic, run.fps) as source:
        camera = source.camera() if run.values.get("use_camera_info") else None
        again = partial(read_again, run.source, run.image_topic, run.fps, run.limit)
        tracker = PictureTracker(make_stabilizer(run.values, camera), need_image=True, read_again=again)
        clock = _Clock(tracker)
        compile_kernels()  # found in the cache: the parent has compiled them
        for picture in source.frames(run.limit):
            _send(connection, *clock.step(picture))
            connection.recv_bytes()
        connection.send((Finished(peak_mb()), None))


class _Clock:
    """Times the steps of a tracker. What one step does ahead for others is shared out among them all."""

    def __init__(self, tracker: PictureTracker) -> None:
        self._tracker = tracker
        self._share_s = 0.0

    def step(self, picture: Picture) -> tuple[TrackedFrame, float]:
        """The result and its seconds."""
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
    connection.send((step, _Pixels(image.shape, image.dtype.str, decoded.encoding)))
    connection.send_bytes(image.data.cast("B"))


class _Reported:
    """Whatever breaks a method is told, and ends its row of the comparison alone."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection

    def __enter__(self) -> None:
        return None

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> bool:
        if isinstance(error, Exception) and not isinstance(error, BrokenPipeError):
            self._connection.send((Failed(_told(error, trace)), None))
        return isinstance(error, Exception)


def _told(error: Exception, trace: TracebackType | None) -> str:
    """What went wrong; of a bug also where."""
    if isinstance(error, StabRosError):
        return one_line(error)
    last = traceback.extract_tb(trace)[-1]
    return one_line(f"{type(error).__name__}: {error} ({Path(last.filename).name}, line {last.lineno})")


def peak_mb() -> int:
    """The most memory this process has held so far, MB (2^20 bytes)."""
    lines = _STATUS.read_text(encoding="utf-8").splitlines()
    return round(next(int(line.split()[1]) for line in lines if line.startswith("VmHWM:")) / 1024)
