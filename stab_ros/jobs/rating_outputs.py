"""The files of a rating curve alone: JSON, its gaugings, and a page."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from stab_ros.discharge.rating import Rating
from stab_ros.evaluation.summary import Json
from stab_ros.io.gauging_file import write_gaugings
from stab_ros.jobs.discharge_outputs import rating_json
from stab_ros.jobs.evaluate_files import write_tree
from stab_ros.jobs.result_outputs import Writers


def rating_writers(rating: Rating) -> Writers:
    """The writers of JSON, CSV and page."""
    tree: Json = {"rating": rating_json(rating)}
    return Writers(partial(write_tree, tree), partial(write_gaugings, rating.gaugings),
                   partial(_write_page, rating, tree))


def _write_page(rating: Rating, tree: Json, folder: Path) -> Path:
    from stab_ros.report.discharge_page import write_rating  # here, as matplotlib takes a second to import

    return write_rating(rating, tree, folder)
