"""The report of `stab-ros evaluate`: numbers, figures and images in one `index.html`."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from markupsafe import Markup

from stab_ros.core.progress import Progress
from stab_ros.core.settings import settings_of
from stab_ros.evaluation.frame_metrics import TITLES, UNITS
from stab_ros.evaluation.results import Evaluation
from stab_ros.evaluation.settings import EvaluatorConfig
from stab_ros.evaluation.summary import as_json, or_more
from stab_ros.report.boxes import box_panels
from stab_ros.report.calibration import calibration_panels
from stab_ros.report.maps import field_panels, point_panels
from stab_ros.report.motion import path_panels, spectrum_panels
from stab_ros.report.numbers import Numbers
from stab_ros.report.overlay import overlay_panels
from stab_ros.report.panel import Section
from stab_ros.report.pictures import ReportImages, Streams, read_pictures
from stab_ros.report.rendering import embedded, own_file, rendered, write_page
from stab_ros.report.scrub import Scrub, scrub_of
from stab_ros.report.series import series_panels
from stab_ros.report.verdict import brightest_frame, compared, extreme_frame, short_name


def write_report(evaluation: Evaluation, streams: Streams, folder: Path, progress: Progress) -> Path:
    """Writes `index.html` into `folder`, which exists. streams: the frames of every evaluated stream.

    Raises:
        InputError: the folder cannot be written into.
        WorkError: the disk is full.
    """
    pictures = read_pictures(evaluation, streams, progress)
    return write_page(_page(evaluation.stabilised_first, pictures, scrub_of(evaluation, pictures)), folder)


def _page(evaluation: Evaluation, pictures: ReportImages, scrub: Scrub) -> str:
    tree = as_json(evaluation)
    numbers = Numbers(tree)
    return rendered(
        "template.html", n=numbers, json=tree, data=embedded(tree), units=UNITS, titles=TITLES,
        meanings=_meanings(), compared=compared(tree), more=or_more, short=short_name,
        extreme_frame=extreme_frame, brightest_frame=brightest_frame,
        script=Markup(own_file("scrub.js")), sections=list(_sections(evaluation, pictures, numbers)), scrub=scrub,
        scrub_data=embedded({"labels": scrub.labels, "streams": [uris for _, uris in scrub.streams]}))


def _sections(evaluation: Evaluation, pictures: ReportImages, numbers: Numbers) -> Iterator[Section]:
    """The figures in the order of the page."""
    topics = evaluation.topics
    yield Section("boxes", "Displacement at the verification points", box_panels(topics))
    yield Section("series", "Over time", series_panels(topics))
    yield Section("field", "Residual velocity field", field_panels(topics))
    yield Section("motion", "Drift and jitter", [*path_panels(topics), *spectrum_panels(topics)])
    yield Section("worst", "Worst frames", overlay_panels(topics, pictures, numbers))
    yield Section("calibration", "From RMSD to displacement", [*calibration_panels(topics), *point_panels(topics)])


def _meanings() -> dict[str, str]:
    """The description of every setting, by its name."""
    return {name: limits.doc for name, _, limits in settings_of(EvaluatorConfig)}
