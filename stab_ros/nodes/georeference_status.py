"""The status of georeferencing on /diagnostics, counted here; without ROS."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from stab_ros.core.text import counted, number
from stab_ros.io.diagnostics_message import ERROR, OK, WARN
from stab_ros.nodes.diagnostic_status import DiagnosticStatus, Summary
from stab_ros.nodes.stream_timeout import StreamTimeout

_COUNTS = ("frames_in", "frames_placed", "frames_unplaced", "frames_dropped", "frames_refused", "messages_refused")


@dataclass(frozen=True)
class Result:
    """What became of a frame. values: those of its status. latency_ns: from its publication to that of `ortho_info`."""

    stamp_ns: int
    reason: str
    warnings: tuple[str, ...]
    values: Mapping[str, str]
    latency_ns: int

    @property
    def placed(self) -> bool:
        return not self.reason


class GeoreferenceStatus:
    """Counts what becomes of images. Times are of the node's free time, ns, unless they are stamps."""

    def __init__(self, orientation: str, stale_ns: int) -> None:
        self.orientation = orientation
        self.waiting_for = "images"
        self.unmade = ""  # why no frame can be placed at all
        self.doubts: tuple[str, ...] = ()  # of the whole stream
        self.faults: Mapping[str, str] = {}  # of publishers, by topic
        self.silent: tuple[str, ...] = ()  # topics that frames no longer wait for
        self.before = self.waiting = self.errors = 0
        self.timeout = StreamTimeout(stale_ns)
        self._counts = dict.fromkeys(_COUNTS, 0)
        self._warnings: dict[str, str] = {}  # by kind, until the next report
        self._newest: dict[str, int] = {}  # stamps of the last messages, by topic
        self._result: Result | None = None

    def on_image(self, free_ns: int) -> None:
        """An image that is taken."""
        self.timeout.on_image(free_ns)
        self.count("frames_in")

    def on_sample(self, topic: str, stamp_ns: int) -> None:
        """A message of a sensor that is used. stamp_ns: on the clock of the frames."""
        self._newest[topic] = max(stamp_ns, self._newest.get(topic, stamp_ns))

    def newest_ns(self, topic: str) -> float:
        """The newest stamp of a sensor, on the clock of the frames."""
        return self._newest.get(topic, -math.inf)

    def on_result(self, result: Result) -> None:
        """The answer to a frame."""
        self.count("frames_placed" if result.placed else "frames_unplaced")
        self._result = result

    def count(self, what: str, more: int = 1) -> None:
        """Adds to one of the counts."""
        self._counts[what] += more

    def warn(self, kind: str, text: str) -> None:
        """A warning for the next report; the last one of each kind is kept."""
        self._warnings[kind] = text

    def restart(self) -> None:
        """Time has begun anew: the stamps of sensors from before mean nothing."""
        self._newest.clear()

    def report(self, free_ns: int) -> DiagnosticStatus:
        """The status since the last report."""
        state = self._state(free_ns)
        once, self._warnings = self._warnings, {}
        warnings = [*self._doubts(state), *once.values()]
        level = ERROR if self.unmade else {"PLACED": OK, "STALE": ERROR}.get(state, WARN)
        message = "; ".join([self._unmade or self._message(state, free_ns), *warnings])
        inactive = Summary(ERROR if self.unmade else WARN if once else OK,
                           "; ".join([self._unmade or "takes no images", *once.values()]))
        return DiagnosticStatus(max(level, WARN) if warnings else level, message, self._values(state), inactive)

    def _doubts(self, state: str) -> list[str]:
        """What is doubtful about the stream, its sensors and the last frame."""
        of_frame = self._result.warnings if self._result is not None and state == "PLACED" else ()
        silent = [f"{topic} is silent, frames do not wait for it" for topic in self.silent]
        return [*self.doubts, *of_frame, *self.faults.values(), *silent]

    @property
    def _unmade(self) -> str:
        """Why no frame can be placed, for people."""
        return f"no frame can be placed: {self.unmade}" if self.unmade else ""

    def _state(self, free_ns: int) -> str:
        if self._result is None or not self.timeout.has_begun:
            return "WAITING"
        if self.timeout.is_stale(free_ns):
            return "STALE"
        return "PLACED" if self._result.placed else "UNPLACED"

    def _message(self, state: str, free_ns: int) -> str:
        if state == "STALE":
            frames = f"{counted(self.waiting, 'frame waits', 'frames wait')} for {self.waiting_for}; "
            return f"{frames if self.waiting else ''}no image for {self.timeout.silence_ns(free_ns) / 1e9:.1f} s"
        if self._result is None or state == "WAITING":
            return f"waiting for {self.waiting_for}"
        return "placed" if self._result.placed else f"unplaced: {self._result.reason}"

    def _values(self, state: str) -> dict[str, str]:
        result = self._result
        ages = {} if result is None else {
            f"{topic}_age_s": number((result.stamp_ns - stamp_ns) / 1e9) for topic, stamp_ns in self._newest.items()}
        return {
            **({} if result is None else result.values),
            "state": state,
            "orientation": self.orientation,
            **{name: str(count) for name, count in self._counts.items()},
            "frames_before": str(self.before),
            "frames_waiting": str(self.waiting),
            "internal_errors": str(self.errors),
            "latency_ms": "" if result is None else f"{result.latency_ns / 1e6:.3f}",
            **ages,
        }
