"""The report of `stab-ros evaluate`: one HTML file to look at, which opens without a network."""

from __future__ import annotations

from stab_ros.report.page import write_report

__all__ = ["write_report"]
