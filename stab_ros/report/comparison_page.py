"""The report of `stab-ros compare`: table, figures and images in one `index.html`."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

from stab_ros.core.progress import Progress
from stab_ros.evaluation.comparison_results import Comparison
from stab_ros.evaluation.comparison_summary import as_json
from stab_ros.evaluation.comparison_table import columns, heads
from stab_ros.evaluation.summary import or_more
from stab_ros.io.frame_reader import Decoded
from stab_ros.report.comparison_boxes import box_panels, cost_panels
from stab_ros.report.comparison_overlay import Warp, overlay_panels
from stab_ros.report.comparison_series import series_panels
from stab_ros.report.comparison_trade import trade_panel
from stab_ros.report.comparison_verdict import alike, best, failed, with_lost
from stab_ros.report.numbers import Numbers
from stab_ros.report.panel import Panel, Section
from stab_ros.report.rendering import embedded, rendered, write_page


def write_comparison(comparison: Comparison, frames: Iterable[Decoded], warp: Warp, folder: Path,
                     progress: Progress) -> Path:
    """Writes `index.html` into `folder`, which exists.

    frames: those of the comparison, in order; iterated once. warp: warps a frame with the settings of a method.

    Raises:
        InputError: the folder cannot be written into.
        WorkError: the disk is full.
    """
    tree = as_json(comparison)
    numbers = Numbers(tree)
    shown = columns(comparison.has_truth)
    overlays = overlay_panels(comparison, frames, warp, numbers, progress)
    return write_page(rendered(
        "compare.html", n=numbers, json=tree, data=embedded(tree), columns=shown, heads=heads(shown),
        sections=list(_sections(comparison, overlays)), best=best, alike=alike,
        with_lost=with_lost, failed=failed, more=or_more), folder)


def _sections(comparison: Comparison, overlays: list[Panel]) -> Iterator[Section]:
    """The figures in the order of the page."""
    yield Section("boxes", "Residual motion", box_panels(comparison))
    yield Section("cost", "Time and memory", [*cost_panels(comparison), trade_panel(comparison)])
    yield Section("series", "Over time", series_panels(comparison))
    yield Section("worst", "Worst frames", overlays)
