"""Whether anything moves among the nodes, so that a slow machine is waited for and one that hangs is not; without ROS.

What a node says on /diagnostics is news if a count or what it waits for has changed. Time is counted in waits.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from stab_ros.nodes.free_time import FreeTime

_PATIENCE_NS = 600 * 10**9  # one kernel, or one frame, takes less on any machine that is worth waiting for
_IDLE_REPORTS = 30  # one a second; a message that DDS lost comes again after 3 s
_COUNTS = ("frames_", "messages", "rounds")


class News:
    """nodes: by the names that their diagnostics end with."""

    def __init__(self, nodes: Iterable[str]) -> None:
        self._free = FreeTime()
        self._moved_ns = 0
        self._heard_ns = dict.fromkeys(nodes, 0)
        self._words: dict[str, str] = {}
        self._counts: dict[str, tuple[str, ...]] = {}
        self._idle = dict.fromkeys(self._heard_ns, 0)

    def waited(self, elapsed_ns: int, most_ns: int) -> None:
        """A wait is over; it counts for `most_ns` at most, as we may have been stopped meanwhile."""
        self._free.waited(elapsed_ns, most_ns)

    def moved(self) -> None:
        """Something came, whatever it is."""
        self._moved_ns = self._free.ns
        self._idle = dict.fromkeys(self._idle, 0)

    def on_report(self, name: str, message: str, values: Mapping[str, str]) -> bool:
        """A status from /diagnostics; whether it was news. What tells how long it is silent already is none."""
        node = name.rpartition("/")[2]
        if node not in self._heard_ns:
            return False
        self._heard_ns[node], self._words[node] = self._free.ns, message
        counts = (message if values.get("state", "WAITING") == "WAITING" else "",
                  *(value for key, value in values.items() if key.startswith(_COUNTS)))
        before, self._counts[node] = self._counts.get(node), counts
        if counts != before:
            self.moved()
            return True
        self._idle[node] += 1
        return False

    def are_idle(self, nodes: Iterable[str]) -> bool:
        """Whether all of these are alive, and again and again had nothing new to tell."""
        return all(self._idle[node] >= _IDLE_REPORTS for node in nodes)

    @property
    def hang(self) -> str:
        """If nothing has moved for too long: in what way; else empty."""
        if self._free.ns - self._moved_ns <= _PATIENCE_NS:
            return ""
        silent = [node for node, heard_ns in self._heard_ns.items() if self._free.ns - heard_ns > _PATIENCE_NS / 2]
        words = [f"{node} said: {self._words[node]}" for node in self._heard_ns if node in self._words]
        what = f"{' and '.join(silent)} gave no sign of life" if silent else "all nodes live, but none goes on"
        return "; ".join([f"{what} for {_PATIENCE_NS / 60e9:.0f} minutes", *words])
