"""Reports of `stab-ros evaluate` and `compare`: one self-contained HTML file each."""

from __future__ import annotations

from stab_ros.report.comparison_page import write_comparison
from stab_ros.report.page import write_report

__all__ = ["write_comparison", "write_report"]
