"""One status on /diagnostics; without ROS."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Summary:
    """level: of diagnostic_msgs/DiagnosticStatus."""

    level: int
    message: str


@dataclass(frozen=True)
class DiagnosticStatus:
    """level: of diagnostic_msgs/DiagnosticStatus. values: keys and values.

    inactive: level and message of a node that takes nothing until it is activated, where that differs: without the
    faults of a stream that is not expected. Its "state" is INACTIVE then.
    """

    level: int
    message: str
    values: dict[str, str]
    inactive: Summary | None = None

    def while_inactive(self) -> DiagnosticStatus:
        """The status of the same node while it takes nothing."""
        if self.inactive is None:
            return self
        return DiagnosticStatus(self.inactive.level, self.inactive.message, {**self.values, "state": "INACTIVE"})
