"""The tracker's status on /diagnostics, counted here; without ROS."""

from __future__ import annotations

from collections.abc import Mapping

from stab_ros.core.text import number
from stab_ros.core.types import Track
from stab_ros.io import advice
from stab_ros.io.diagnostics_message import ERROR, OK, WARN
from stab_ros.nodes.diagnostic_status import DiagnosticStatus, Summary
from stab_ros.nodes.stream_timeout import StreamTimeout
from stab_ros.tracking.ground_choice import CompetingHypothesis
from stab_ros.tracking.parallax import Relief
from stab_ros.tracking.rolling_shutter import Swing
from stab_ros.tracking.start_buffer import GroundState


class TrackerStatus:
    """Counts what becomes of images. Times are of the node's free time, ns."""

    def __init__(self, method: str, stale_ns: int) -> None:
        self.method = method
        self.waiting_for = "image"
        self.competing: CompetingHypothesis | None = None  # a plane that may be the ground as well
        self.relief: Relief | None = None  # parallax that shows that the ground is not one plane
        self.swing: Swing | None = None  # of the rows, by a rolling shutter
        self.copied: float | None = None  # share that the video codec has copied, if it is much
        self.stamps: Mapping[str, str] = {}  # counts of irregular ones
        self.before = 0  # images published before the first that was received
        self.ground = GroundState.UNDECIDED
        self.timeout = StreamTimeout(stale_ns)
        self.asleep = False  # nobody listens, and no images are taken
        self.errors = 0  # internal ones so far
        self._received = self._tracked = self._lost = self._dropped = self._refused = 0
        self._warnings: dict[str, str] = {}  # by kind, until the next report
        self._latency_ns = 0
        self._track: Track | None = None
        self._lost_reason = ""  # of the last frame that was lost

    def on_image(self, free_ns: int) -> float:
        """An image that is tracked, now or later. Returns the silence before it, s, if the stream was stale, else 0."""
        stale, silence_ns = self.timeout.is_stale(free_ns), self.timeout.on_image(free_ns)
        self._received += 1
        return silence_ns / 1e9 if stale else 0.0

    def on_track(self, track: Track, latency_ns: int) -> None:
        """A result. latency_ns: from the publication of the image to that of its homography."""
        self._tracked += track.tracked
        self._lost += not track.tracked
        if track.lost_reason is not None:
            self._lost_reason = track.lost_reason.value
        self._track, self._latency_ns = track, latency_ns

    def on_refused(self) -> None:
        """An image that cannot be used."""
        self._received += 1
        self._refused += 1

    def on_dropped(self, images: int) -> None:
        """Images that were published but not tracked."""
        self._dropped += images

    def on_failure(self, errors: int, text: str) -> None:
        """errors: internal ones so far. text: the last one."""
        self.errors = errors
        self.warn("internal", text)

    def warn(self, kind: str, text: str) -> None:
        """A warning for the next report; the last one of each kind is kept."""
        self._warnings[kind] = text

    def report(self, free_ns: int) -> DiagnosticStatus:
        """The status since the last report."""
        state = self._state(free_ns)
        level = {"TRACKED": OK, "ASLEEP": OK, "STALE": ERROR}.get(state, WARN)
        warnings = self._all_warnings()
        least = WARN if warnings else OK
        message, inactive = ("; ".join([first, *warnings]) for first in (
            self._message(state, free_ns), "takes no images"))
        return DiagnosticStatus(max(level, least), message, self._values(state), Summary(least, inactive))

    def _all_warnings(self) -> list[str]:
        """What is worth a warning now; those of a kind are told once."""
        once, self._warnings = self._warnings, {}
        return [*advice.remarks(self.competing, self.relief, self.swing, self.copied), *once.values()]

    def _state(self, free_ns: int) -> str:
        if self.asleep:
            return "ASLEEP"
        if self._track is None or not self.timeout.has_begun:
            return "WAITING"
        return "STALE" if self.timeout.is_stale(free_ns) else self._track.state.value

    def _message(self, state: str, free_ns: int) -> str:
        if state == "ASLEEP":
            return "asleep until somebody listens"
        if state == "WAITING":
            return f"waiting for {self.waiting_for}"
        if state == "STALE":
            return f"no image for {self.timeout.silence_ns(free_ns) / 1e9:.1f} s"
        return f"lost: {self._lost_reason}" if state == "LOST" else state.lower()

    def _values(self, state: str) -> dict[str, str]:
        track = self._track
        return {
            "state": state,
            "method": self.method,
            "frames_in": str(self._received),
            "frames_tracked": str(self._tracked),
            "frames_lost": str(self._lost),
            "lost_reason": self._lost_reason,
            "frames_dropped": str(self._dropped),
            "frames_refused": str(self._refused),
            "frames_before": str(self.before),
            "internal_errors": str(self.errors),
            **self.stamps,
            "matches": str(track.matches if track else 0),
            "inliers": str(track.inliers if track else 0),
            "rmse_px": number(track.rmse_px if track else None),
            "sigma_px": number(track.sigma_px if track else None),
            "latency_ms": f"{self._latency_ns / 1e6:.3f}" if track else "",
            "reset_counter": str(track.reset_counter if track else 0),
            "ground": self.ground.value,
            "rival_share": number(self.competing.share if self.competing else None),
            "parallax_px": number(self.relief.px if self.relief else None),
            "parallax_deg": number(self.relief.deg if self.relief else None),
            "rows_px": number(self.swing.most_px if self.swing else None),
        }
