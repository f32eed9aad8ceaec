"""One status on /diagnostics; without ROS."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class DiagnosticStatus:
    """level: of diagnostic_msgs/DiagnosticStatus. values: keys and values."""

    level: int
    message: str
    values: dict[str, str]
