"""The page of `stab-ros discharge`: numbers and figures in one `index.html`."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from stab_ros.discharge.rating import Rating
from stab_ros.discharge.result import Discharge
from stab_ros.evaluation.summary import Json
from stab_ros.report.discharge_plots import draws_panel, plan_panel, section_panels, sources_panel
from stab_ros.report.discharge_rating import rating_panel
from stab_ros.report.numbers import Numbers
from stab_ros.report.panel import Section
from stab_ros.report.rendering import embedded, rendered, write_page
from stab_ros.velocimetry.vectors import Vectors


def write_discharge(found: Discharge, vectors: Vectors, rating: Rating | None, tree: Json, folder: Path) -> Path:
    """Writes `index.html` into `folder`, which exists.

    tree: the JSON of the measurement; all numbers of the page are in it.

    Raises:
        InputError: the folder cannot be written into.
        WorkError: the disk is full.
    """
    alpha = float(tree["settings"]["alpha"])
    return write_page(rendered("discharge.html", n=Numbers(tree), json=tree, data=embedded(tree),
                               sections=list(_sections(found, vectors, rating, alpha))), folder)


def _sections(found: Discharge, vectors: Vectors, rating: Rating | None, alpha: float) -> Iterator[Section]:
    """The figures in the order of the page."""
    yield Section("section", "Across the river", [*section_panels(found, alpha), plan_panel(found, vectors)])
    yield Section("uncertainty", "Uncertainty", [draws_panel(found), sources_panel(found)])
    if rating is not None:
        yield Section("rating", "Rating curve", [rating_panel(rating)])


def write_rating(rating: Rating, tree: Json, folder: Path) -> Path:
    """The page of a rating curve alone; raises as `write_discharge`."""
    sections = [Section("rating", "Rating curve", [rating_panel(rating)])]
    page = rendered("rating.html", n=Numbers(tree), json=tree, data=embedded(tree), sections=sections)
    return write_page(page, folder)
