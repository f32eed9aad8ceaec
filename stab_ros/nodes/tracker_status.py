"""What the tracker says of itself on /diagnostics: counted here, without ROS."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from stab_ros.core.text import number
from stab_ros.core.types import Track
from stab_ros.io.messages import ERROR, OK, WARN
from stab_ros.nodes.silence import Silence
from stab_ros.tracking.ground_choice import CompetingHypothesis
from stab_ros.tracking.parallax import Relief
from stab_ros.tracking.start_buffer import GroundState


@dataclass(frozen=True)
class Report:
    """One diagnostic status."""

    level: int
    message: str
    values: dict[str, str]


class TrackerStatus:
    """Counts what happens to frames. Times are of the node's free time, ns."""

    def __init__(self, method: str, stale_ns: int) -> None:
        self.method = method
        self.waiting_for = "image"
        self.rival: CompetingHypothesis | None = None  # what may be the ground as well
        self.relief: Relief | None = None  # what shows that the ground is no plane
        self.stamps: Mapping[str, str] = {}  # counts of odd ones
        self.before = 0  # images published before the first that reached us
        self.ground = GroundState.UNDECIDED
        self.silence = Silence(stale_ns)
        self._received = self._tracked = self._lost = self._dropped = self._refused = 0
        self._remarks: dict[str, str] = {}  # by kind, until the next report
        self._latency_ns = 0
        self._track: Track | None = None

    def on_image(self, free_ns: int) -> float:
        """An image that is answered, now or later. Seconds without any before if that was too long, else 0."""
        stale, silent_ns = self.silence.is_stale(free_ns), self.silence.broken(free_ns)
        self._received += 1
        return silent_ns / 1e9 if stale else 0.0

    def on_track(self, track: Track, latency_ns: int) -> None:
        """An answer. latency_ns: from the image's publication to that of its homography."""
        self._tracked += track.tracked
        self._lost += not track.tracked
        self._track, self._latency_ns = track, latency_ns

    def on_refused(self) -> None:
        """An image that could not be used."""
        self._received += 1
        self._refused += 1

    def on_dropped(self, frames: int) -> None:
        """Images that were published but never reached us."""
        self._dropped += frames

    def remark(self, kind: str, text: str) -> None:
        """What the next report tells, once; of each kind the last."""
        self._remarks[kind] = text

    def report(self, free_ns: int) -> Report:
        """The status since the last report."""
        state = self._state(free_ns)
        level = {"TRACKED": OK, "STALE": ERROR}.get(state, WARN)
        message = self._message(state, free_ns)
        remarks, self._remarks = self._remarks, {}
        for remark in (self.rival, self.relief, *remarks.values()):
            if remark is not None:
                level, message = max(level, WARN), f"{message}; {remark}"
        return Report(level, message, self._values(state))

    def _state(self, free_ns: int) -> str:
        if self._track is None:
            return "WAITING"
        return "STALE" if self.silence.is_stale(free_ns) else self._track.state.value

    def _message(self, state: str, free_ns: int) -> str:
        if state == "WAITING":
            return f"waiting for {self.waiting_for}"
        if state == "STALE":
            return f"no image for {self.silence.ns(free_ns) / 1e9:.1f} s"
        return state.lower()

    def _values(self, state: str) -> dict[str, str]:
        track = self._track
        return {
            "state": state,
            "method": self.method,
            "frames_in": str(self._received),
            "frames_tracked": str(self._tracked),
            "frames_lost": str(self._lost),
            "frames_dropped": str(self._dropped),
            "frames_refused": str(self._refused),
            "frames_before": str(self.before),
            **self.stamps,
            "matches": str(track.matches if track else 0),
            "inliers": str(track.inliers if track else 0),
            "rmse_px": number(track.rmse_px if track else None),
            "sigma_px": number(track.sigma_px if track else None),
            "latency_ms": f"{self._latency_ns / 1e6:.3f}" if track else "",
            "reset_counter": str(track.reset_counter if track else 0),
            "ground": self.ground.value,
            "rival_share": number(self.rival.share if self.rival else None),
            "parallax_px": number(self.relief.px if self.relief else None),
            "parallax_deg": number(self.relief.deg if self.relief else None),
        }
