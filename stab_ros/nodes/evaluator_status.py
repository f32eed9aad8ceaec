"""The evaluator's status on /diagnostics: counts, statistics and recent problems of the stream; without ROS."""

from __future__ import annotations

import re
from collections import Counter, deque
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from stab_ros.core.text import number
from stab_ros.evaluation.evaluator import Arrival
from stab_ros.evaluation.findings import Finding, Level, frame_name
from stab_ros.evaluation.frame_metrics import UNITS, FrameMetrics, Outcome
from stab_ros.metrics.statistics import summarize
from stab_ros.nodes.diagnostic_status import DiagnosticStatus, Summary
from stab_ros.nodes.stream_timeout import StreamTimeout

_SHOWN = 3  # problems in one message
_BEHIND_NS = 1_000_000_000  # a longer delay is a problem
_NUMBER = re.compile(r"[-+]?\d+(\.\d+)?")


@dataclass(frozen=True)
class _Problem:
    """One line about one frame. kind: equal for the same problem of other frames."""

    now_ns: int
    level: Level
    kind: str
    frame: str
    text: str


class EvaluatorStatus:
    """Counts frames and remembers the problems of the last ones.

    now_ns: of a monotonic clock. free_ns: of the node's free time. window_ns: the period of the statistics. alarm_ns:
    how long a problem of a frame is reported. stale_ns: silence after which the stream counts as stopped.
    """

    def __init__(self, window_ns: int, alarm_ns: int, stale_ns: int) -> None:
        self.waiting_for = "images"
        self._window_ns, self._alarm_ns, self._timeout = window_ns, alarm_ns, StreamTimeout(stale_ns)
        self._counts: Counter[str] = Counter()
        self._measured: deque[tuple[int, Mapping[str, float]]] = deque()
        self._problems: deque[_Problem] = deque()
        self._last = ""

    def on_alive(self, free_ns: int) -> None:
        """An image has arrived, or the message that the frame is lost and has none."""
        self._timeout.on_image(free_ns)

    def suspend(self) -> None:
        """No images are expected until the next one."""
        self._timeout.suspend()

    def on_frame(self, arrival: Arrival) -> None:
        """A frame that is to be measured."""
        self._counts["frames_in"] += 1
        self._last = _name(arrival)

    def on_metrics(self, metrics: FrameMetrics, found: Sequence[Finding], now_ns: int) -> None:
        """The result of a frame. found: its problems."""
        self._counts[metrics.outcome.value] += 1
        if metrics.outcome is Outcome.MEASURED:
            self._measured.append((now_ns, metrics.values))
        name = frame_name(metrics)
        for one in found:
            self._problem(now_ns, one.level, name, one.text)

    def on_refused(self, level: Level, text: str, now_ns: int) -> None:
        """A message or a frame that cannot be used."""
        self._counts["frames_refused"] += 1
        self._problem(now_ns, level, "", text)

    def on_failure(self, errors: int, text: str, now_ns: int) -> None:
        """errors: internal ones so far. text: the last one."""
        self._counts["internal_errors"] = errors
        self._problem(now_ns, Level.ERROR, "", text)

    def on_skipped(self, arrival: Arrival, now_ns: int) -> None:
        """A frame that is dropped because the backlog is full."""
        self._counts["frames_skipped"] += 1
        name = _name(arrival)
        self._problem(now_ns, Level.WARN, name, f"{name} is skipped, too many are waiting")

    def on_check_skipped(self, arrival: Arrival, now_ns: int) -> None:
        """RMSE and velocity field were due on this frame, and are skipped as the backlog is more than half full."""
        self._counts["checks_skipped"] += 1
        name = _name(arrival)
        self._problem(now_ns, Level.WARN, name, f"{name}: RMSE and velocity field are skipped, many are waiting")

    def level(self, now_ns: int, delay_ns: int, free_ns: int) -> Level:
        """The level that a report would have now."""
        return max((level for level, _ in self._current_problems(now_ns, delay_ns, free_ns)), default=Level.OK)

    def report(self, now_ns: int, delay_ns: int, free_ns: int) -> DiagnosticStatus:
        """delay_ns: how long the oldest frame has been waiting."""
        self._forget(now_ns)
        summary = self._summary(self._current_problems(now_ns, delay_ns, free_ns))
        inactive = self._summary(self._problems_of_frames(now_ns, delay_ns))
        return DiagnosticStatus(summary.level, summary.message, self._values(delay_ns, free_ns), inactive)

    def _summary(self, found: Iterable[tuple[Level, str]]) -> Summary:
        """The worst of the problems first."""
        problems = sorted(found, key=lambda one: -one[0])
        texts = [text for _, text in problems]
        more = [f"and {len(texts) - _SHOWN} more"] if len(texts) > _SHOWN else []
        message = "; ".join([*texts[:_SHOWN], *more]) or self._fine
        return Summary(max((level for level, _ in problems), default=Level.OK), message)

    def _current_problems(self, now_ns: int, delay_ns: int, free_ns: int) -> Iterator[tuple[Level, str]]:
        """All problems now, each kind once."""
        if self._is_stale(free_ns):
            silence_s = self._timeout.silence_ns(free_ns) / 1e9
            yield Level.ERROR, f"no image for {silence_s:.1f} s, the last was {self._last}"
        yield from self._problems_of_frames(now_ns, delay_ns)
        if self._is_waiting:
            yield Level.WARN, f"waiting for {self.waiting_for}"

    def _problems_of_frames(self, now_ns: int, delay_ns: int) -> Iterator[tuple[Level, str]]:
        """Those of frames that have come, each kind once."""
        kinds: dict[tuple[Level, str], list[_Problem]] = {}
        for one in self._problems:
            if now_ns - one.now_ns <= self._alarm_ns:
                kinds.setdefault((one.level, one.kind), []).append(one)
        for (level, _), alike in kinds.items():
            yield level, _merged(alike)
        if delay_ns > _BEHIND_NS:
            yield Level.WARN, f"{delay_ns / 1e9:.1f} s behind"

    @property
    def _fine(self) -> str:
        return f"no problem up to {self._last}" if self._last else "takes no images"

    @property
    def _is_waiting(self) -> bool:
        return not (self._timeout.has_begun and self._last)

    def _is_stale(self, free_ns: int) -> bool:
        return bool(self._last) and self._timeout.is_stale(free_ns)

    def _problem(self, now_ns: int, level: Level, frame: str, text: str) -> None:
        self._problems.append(_Problem(now_ns, level, _NUMBER.sub("", text), frame, text))

    def _forget(self, now_ns: int) -> None:
        while self._problems and now_ns - self._problems[0].now_ns > self._alarm_ns:
            self._problems.popleft()
        while self._measured and now_ns - self._measured[0][0] > self._window_ns:
            self._measured.popleft()

    def _values(self, delay_ns: int, free_ns: int) -> dict[str, str]:
        counts = self._counts
        values = {
            "state": self._state(free_ns),
            "frames_in": counts["frames_in"],
            "frames_measured": counts[Outcome.MEASURED.value],
            "frames_lost": counts[Outcome.LOST.value],
            "frames_without_image": counts[Outcome.NO_IMAGE.value],
            "frames_refused": counts["frames_refused"],
            "frames_skipped": counts["frames_skipped"],
            "checks_skipped": counts["checks_skipped"],
            "internal_errors": counts["internal_errors"],
            "delay_s": f"{delay_ns / 1e9:.3f}",
        }
        latest = self._measured[-1][1] if self._measured else {}
        if "velocity_error_m_s" in latest:
            values["velocity_error_m_s"] = number(latest["velocity_error_m_s"])
        return {key: str(value) for key, value in values.items()} | self._statistics()

    def _state(self, free_ns: int) -> str:
        return "WAITING" if self._is_waiting else "STALE" if self._is_stale(free_ns) else "MEASURING"

    def _statistics(self) -> dict[str, str]:
        found: dict[str, str] = {}
        for name in UNITS:
            summary = summarize([values[name] for _, values in self._measured if name in values])
            found[f"{name}.median"] = number(summary.median if summary else None)
            found[f"{name}.p95"] = number(summary.p95 if summary else None)
            found[f"{name}.max"] = number(summary.max if summary else None)
            found[f"{name}.count"] = str(summary.count if summary else 0)
        return found


def _merged(alike: Sequence[_Problem]) -> str:
    """The same problem of several frames in one line that names the first and the last."""
    first, last = alike[0], alike[-1]
    if len(alike) == 1:
        return first.text
    until = f" until {last.frame}" if last.frame else ""
    return f"{first.text} (and {len(alike) - 1} more{until})"


def _name(arrival: Arrival) -> str:
    return frame_name(FrameMetrics(arrival.index, arrival.stamp_ns, Outcome.NO_IMAGE))
