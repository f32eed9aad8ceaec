"""Detects whether the nodes make progress, to tell a slow machine from one that hangs; without ROS.

A report of a node on /diagnostics is news if a count, or what the node waits for, has changed. Time is the sum of
the waits.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from stab_ros.nodes.free_time import FreeTime

_PATIENCE_NS = 600 * 10**9  # longer than one kernel or one frame takes on any usable machine
_IDLE_REPORTS = 30  # one a second; a message that DDS lost comes again after 3 s
_COUNTS = ("frames_", "messages", "rounds")


class News:
    """The progress of several nodes. nodes: the last parts of the names of their diagnostics."""

    def __init__(self, nodes: Iterable[str]) -> None:
        self._free = FreeTime()
        self._moved_ns = 0
        self._heard_ns = dict.fromkeys(nodes, 0)
        self._words: dict[str, str] = {}
        self._counts: dict[str, tuple[str, ...]] = {}
        self._idle = dict.fromkeys(self._heard_ns, 0)

    def waited(self, elapsed_ns: int, most_ns: int) -> None:
        """Adds a wait; it counts for `most_ns` at most, as this process may have been stopped meanwhile."""
        self._free.waited(elapsed_ns, most_ns)

    def moved(self) -> None:
        """Notes progress of any kind."""
        self._moved_ns = self._free.ns
        self._idle = dict.fromkeys(self._idle, 0)

    def on_report(self, name: str, message: str, values: Mapping[str, str]) -> bool:
        """Takes a status from /diagnostics; returns whether it was news. The duration of a silence is not."""
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
        """Whether all these nodes have sent reports without news for some time."""
        return all(self._idle[node] >= _IDLE_REPORTS for node in nodes)

    @property
    def hang(self) -> str:
        """A description of the nodes if nothing has progressed for too long; else ""."""
        if self._free.ns - self._moved_ns <= _PATIENCE_NS:
            return ""
        silent = [node for node, heard_ns in self._heard_ns.items() if self._free.ns - heard_ns > _PATIENCE_NS / 2]
        words = [f"{node} said: {self._words[node]}" for node in self._heard_ns if node in self._words]
        what = f"{' and '.join(silent)} gave no sign of life" if silent else "all nodes live, but none goes on"
        return "; ".join([f"{what} for {_PATIENCE_NS / 60e9:.0f} minutes", *words])
