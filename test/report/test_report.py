"""The HTML report: its numbers are those of the JSON, it needs nothing from elsewhere, and it shows what happened."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import Command
from recordings import entries, write_mcap
from report_page import Page, decoded, looked_up
from truth import IDENTITY, flat, frame, picture, translation, unmoved

from stab_ros import __version__
from stab_ros.cli import main
from stab_ros.core.types import Gray
from stab_ros.evaluation.frame_metrics import COUNTS
from stab_ros.io.bag import BagWriter, topic_of
from stab_ros.io.cdr import CAMERA_INFO, IMAGE, header_of
from stab_ros.io.homography_message import homography_cdr
from stab_ros.io.image_message import image_cdr
from stab_ros.report.numbers import shown
from stab_ros.report.overlay import edges, overlaid
from stab_ros.synthetic.flight import Shot

SIZE = (480, 360)
SECTIONS = ("boxes", "series", "field", "motion", "worst", "calibration")


@pytest.fixture(scope="module")
def report(flight: list[Shot], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Of a small flight, raw and stabilised."""
    folder = tmp_path_factory.mktemp("report")
    raw = write_mcap(folder / "raw.mcap", list(entries(flight)))
    both, pages = str(folder / "both.mcap"), str(folder / "report")
    assert main(["stabilize", str(raw), both, "--keep-raw"]) == 0
    assert main(["evaluate", both, "--report", pages, "-p", "gsd_m:=0.02", "-p", "rmse_every:=2"]) == 0
    return folder / "report"


def test_every_number_in_the_text_is_that_of_the_json(report: Path) -> None:
    page, beside = Page(report / "index.html"), json.loads((report / "metrics.json").read_text(encoding="utf-8"))
    embedded = json.loads(page.scripts["evaluation"])
    assert embedded == beside
    assert len(page.numbers) > 200
    for pointer, text in page.numbers:
        value = looked_up(embedded, pointer)
        assert text == shown(value, *pointer.split("/")), pointer
        if isinstance(value, float) and not COUNTS.intersection(pointer.split("/")):
            assert float(text) == pytest.approx(value, abs=0.00051), pointer
    told = {pointer for pointer, _ in page.numbers}
    for topic in ("~1cam~1image_raw", "~1cam~1image_stabilized"):
        for name in ("rmsd_reference", "displacement_previous_px", "rmse_reference_px", "velocity_error_m_s"):
            assert {f"/topics/{topic}/{name}/{key}" for key in ("median", "p95", "max", "count")} <= told


def test_there_are_no_other_numbers(report: Path) -> None:
    page = Page(report / "index.html")
    text = re.sub(r"frame \d+ \([\d.]+ s\)", "", page.unnumbered)  # what a frame is called
    for topic in json.loads(page.scripts["evaluation"])["topics"].values():
        for line in topic["findings"]["worst"]:
            text = text.replace(re.sub(r"frame \d+ \([\d.]+ s\)", "", line), "")
    fixed = {"1.5", "2.5.1", "0.5", __version__}  # whiskers, a section of the paper, and the software's version
    keys = set(re.findall(r"the key shows ([\d.]+) px", text))
    assert set(re.findall(r"\d+(?:\.\d+)+", text)) <= fixed | keys


def test_the_worst_frames_are_told_with_their_numbers(report: Path) -> None:
    page = Page(report / "index.html")
    told = [pointer for pointer, _ in page.numbers if re.search(r"/per_frame/\d+/displacement_reference_px", pointer)]
    expected = []
    for name, topic in json.loads(page.scripts["evaluation"])["topics"].items():
        values = [row["displacement_reference_px"] or 0.0 for row in topic["per_frame"]]
        worst = np.argsort(np.negative(values), kind="stable")[:3]
        rows = f"/topics/{name.replace('/', '~1')}/per_frame"
        expected += [f"{rows}/{index}/displacement_reference_px" for index in worst]
    assert told == expected


def test_raw_and_stabilised_are_compared_in_one_sentence(report: Path) -> None:
    page = Page(report / "index.html")
    topics = json.loads(page.scripts["evaluation"])["topics"]
    steady, raw = (shown(topics[name]["displacement_reference_px"]["median"])
                   for name in ("/cam/image_stabilized", "/cam/image_raw"))
    text = " ".join(page.text.split())
    assert re.search(rf"moves less: /cam/image_stabilized is displaced by {steady} px instead of {raw} px( or more)? "
                     "in /cam/image_raw, against the reference", text)
    assert re.search(r"which is [\d.]+ m/s instead of [\d.]+ m/s \(medians\)", text)
    assert f"Displaced by {steady} px (median) against the reference, at most " in text
    assert "10 frames, none lost." in text


@pytest.mark.parametrize(("value", "text"), [
    (None, "-"), (3, "3"), (3.0, "3"), (1.23456, "1.235"), (-0.04, "-0.040"), (0.0042, "0.0042"), (0.00084, "0.00084"),
    (0.0, "0"),
    (True, "True"), (1e-6, "1e-06")])
def test_how_numbers_are_written(value: Any, text: str) -> None:
    assert shown(value) == text


def test_it_is_one_file_that_needs_no_network(report: Path) -> None:
    page = Page(report / "index.html")
    assert page.links
    assert all(link.startswith("data:") for link in page.links)
    text = re.sub(r"base64,[A-Za-z0-9+/=]+", "", page.source)
    assert not re.search(r"//[a-z]|@import|url\(", text)
    assert page.source.count("<!doctype html>") == 1


def test_every_figure_is_there_with_a_text_for_those_who_cannot_see_it(report: Path) -> None:
    page = Page(report / "index.html")
    assert set(SECTIONS) <= set(page.ids)
    assert all(image.get("alt") for image in page.images)
    figures = [image for image in page.images if image.get("class") != "scrub"]
    # boxes 2 x 2, series 3, fields 2, paths 2 and spectrum, overlays 2 x 3 x 2, fit, points
    assert len(figures) >= 4 + 3 + 2 + 3 + 12 + 2
    for image in figures:
        drawn = decoded(image["src"] or "")
        assert min(drawn.shape[:2]) > 300
        assert drawn.std() > 5, "not empty"


def test_the_scrub_holds_both_streams_in_step(report: Path) -> None:
    page = Page(report / "index.html")
    frames = json.loads(page.scripts["scrub-frames"])
    assert frames["labels"][0].startswith("frame 0 ")
    assert frames["labels"][-1].startswith("frame 9 ")
    raw, steady = ([decoded(uri) for uri in stream] for stream in frames["streams"])
    assert len(raw) == len(steady) == len(frames["labels"]) == 10
    assert np.abs(raw[0].astype(int) - steady[0]).mean() < 2, "the first is the reference of both"
    assert np.abs(raw[-1].astype(int) - steady[-1]).mean() > 2


def written(path: Path, images: list[Gray]) -> Path:
    with BagWriter(path) as writer:
        writer.add_topic(topic_of("/cam/steady", IMAGE))
        for index, gray in enumerate(images):
            one = frame(gray, index)
            writer.write("/cam/steady", one.stamp_ns, one.stamp_ns, image_cdr(gray, "mono8", header_of(one)))
    return path


def page_of(command: Command, path: Path, *options: object) -> Page:
    done = command("evaluate", path, "--report", path.parent / "report", *options)
    assert done.returncode == 0, done.stderr
    return Page(path.parent / "report" / "index.html")


@pytest.mark.parametrize("images", [
    [flat(size=SIZE), flat(level=91, size=SIZE)], [picture(IDENTITY, SIZE)],
    pytest.param([picture(IDENTITY, SIZE), picture(translation(1, 0), SIZE)], marks=pytest.mark.thorough),
], ids=["flat", "reference alone", "two frames"])
def test_where_there_is_little_it_says_so(images: list[Gray], command: Command, tmp_path: Path) -> None:
    page = page_of(command, written(tmp_path / "little.mcap", images))
    assert set(SECTIONS) <= set(page.ids)
    assert "nothing to draw" in page.text or "Too few frames" in page.text
    for pointer, text in page.numbers:
        assert text == shown(looked_up(json.loads(page.scripts["evaluation"]), pointer), *pointer.split("/"))


def test_names_are_no_markup_and_a_brightness_change_is_told(command: Command, tmp_path: Path) -> None:
    images = [picture(IDENTITY, SIZE), picture(IDENTITY, SIZE, gain=1.05)]
    page = page_of(command, written(tmp_path / "a<b>&'c.mcap", images))
    assert "a<b>&'c.mcap" in page.text
    assert "<b>" not in page.source
    assert "brightness changed by +5" in page.text


def test_edges_of_the_reference_are_red_those_of_the_frame_cyan() -> None:
    def square(left: int) -> Gray:
        gray = np.full((100, 200), 60, np.uint8)
        gray[30:70, left : left + 60] = 200
        return gray

    both = overlaid(square(40), square(100)).astype(int)
    red = (both[:, :, 0] == 255) & (both[:, :, 1] < 100)
    cyan = (both[:, :, 0] < 100) & (both[:, :, 1] == 255) & (both[:, :, 2] == 255)
    assert red[35:65, 37:43].any(axis=1).all(), "left side of the reference's square"
    assert cyan[35:65, 157:163].any(axis=1).all(), "right side of the frame's square"
    assert not cyan[35:65, 30:50].any()
    assert not red[35:65, 150:170].any()
    still = overlaid(square(40), square(40))
    assert (still[:, :, 0] == still[:, :, 1]).all(), "white where they agree"
    assert not edges(np.full((50, 50), 90, np.uint8)).any()


@pytest.mark.parametrize("lost", [(2, 3), (1, 2, 3, 4)], ids=["some", "all but the reference"])
def test_lost_frames(lost: tuple[int, ...], command: Command, tmp_path: Path) -> None:
    path = tmp_path / "lost.mcap"
    with BagWriter(path) as writer:
        writer.add_topic(topic_of("/cam/image_stabilized", IMAGE))
        writer.add_topic(topic_of("/cam/homography", CAMERA_INFO))
        for index in range(5):
            one = frame(picture(translation(0.02 * index, 0), SIZE), index)
            track = unmoved(one, index, lost=index in lost)
            writer.write("/cam/homography", one.stamp_ns, one.stamp_ns, homography_cdr(track, header_of(one), one.size))
            if index not in lost:
                cdr = image_cdr(one.image, "mono8", header_of(one))
                writer.write("/cam/image_stabilized", one.stamp_ns, one.stamp_ns, cdr)
    page = page_of(command, path)
    text = " ".join(page.text.split())
    assert f"5 frames, {len(lost)} lost." in text
    assert f"frame {lost[0]} " in text, "each is an error"
    if len(lost) == 2:
        assert "Red ticks at the bottom" in text
    else:
        assert "No displacement could be measured" in text
    labels = json.loads(page.scripts["scrub-frames"])["labels"]
    assert [label.split()[1] for label in labels] == [str(index) for index in range(5) if index not in lost]


def test_one_stream_stands_alone(recordings: dict[str, Path], command: Command, tmp_path: Path) -> None:
    done = command("evaluate", recordings["video"], "--report", tmp_path / "report")
    assert done.returncode == 0, done.stderr
    page = Page(tmp_path / "report" / "index.html")
    assert "instead of" not in page.text
    assert "Before and after" not in page.text
    assert len(json.loads(page.scripts["scrub-frames"])["streams"]) == 1


@pytest.mark.thorough
def test_streams_without_a_common_stamp_are_leafed_through_by_number(command: Command, tmp_path: Path) -> None:
    path = tmp_path / "late.mcap"
    levels = [picture(IDENTITY, SIZE, offset=10.0 * index) for index in range(3)]
    with BagWriter(path) as writer:
        for topic, late_ns in (("/a/one", 0), ("/b/two", 7_000_000)):
            writer.add_topic(topic_of(topic, IMAGE))
            for index, gray in enumerate(levels):
                one = frame(gray, index)
                stamped = replace(one, stamp_ns=one.stamp_ns + late_ns)
                writer.write(topic, stamped.stamp_ns, stamped.stamp_ns, image_cdr(gray, "mono8", header_of(stamped)))
    page = page_of(command, path, "--image-topic", "/a/one", "--image-topic", "/b/two")
    first, second = ([decoded(uri).mean() for uri in stream] for stream in
                     json.loads(page.scripts["scrub-frames"])["streams"])
    assert first == pytest.approx(second, abs=0.5)
    assert np.diff(second).min() > 5


def shares_of_red_and_cyan(page: Page) -> tuple[float, float]:
    """Of the pixels of the last overlay, the part at full resolution."""
    uri = [image["src"] or "" for image in page.images if "pixel by pixel" in (image["alt"] or "")][-1]
    blue, green, red = np.moveaxis(decoded(uri).astype(int), 2, 0)
    return float(np.mean((red > 150) & (green < 110))), float(np.mean((red < 110) & (green > 150) & (blue > 150)))


def test_the_overlay_of_a_displaced_frame_is_red_and_cyan(command: Command, tmp_path: Path) -> None:
    for name, distance_px in (("still", 0.0), ("displaced", 3.0)):
        (tmp_path / name).mkdir()
        images = [picture(IDENTITY, SIZE, noise=0), picture(translation(distance_px, 0), SIZE, noise=0)]
        shares = shares_of_red_and_cyan(page_of(command, written(tmp_path / name / "bag.mcap", images)))
        if distance_px:
            assert min(shares) > 0.02
        else:
            assert max(shares) < 0.001


@pytest.mark.thorough
@pytest.mark.filterwarnings("error::UserWarning")
def test_many_points_leave_room_for_the_figures(command: Command, tmp_path: Path) -> None:
    places = [(40 + 44 * column, 40 + 68 * row) for row in range(5) for column in range(10)]
    points = tmp_path / "points.csv"
    points.write_text("name,x,y\n" + "".join(f"a long name {x}.{y},{x},{y}\n" for x, y in places), encoding="utf-8")
    images = [picture(IDENTITY, SIZE), picture(translation(0.4, 0), SIZE)]
    page = page_of(command, written(tmp_path / "many.mcap", images), "--points", points)
    assert len(json.loads(page.scripts["evaluation"])["topics"]["/cam/steady"]["points"]) == len(places)
    for image in page.images:
        height, width = decoded(image["src"] or "").shape[:2]
        assert height < 1.4 * width


def verdicts(page: Page) -> list[str]:
    """The class of each stream's box, in the order of the page: its colour."""
    return re.findall(r'<section class="verdict (good|bad|unsure)">', page.source)


@pytest.mark.thorough
def test_a_stream_that_moves_is_told_in_words_and_colour(command: Command, tmp_path: Path) -> None:
    images = [picture(translation(shift, 0), SIZE) for shift in (0, 3, 3.5, 3)]
    page = page_of(command, written(tmp_path / "moves.mcap", images))
    assert verdicts(page) == ["bad"]
    assert re.search(r"Moves by [23]\.\d+ px \(median", " ".join(page.text.split()))


def test_where_nothing_was_gained_it_says_so_in_red(command: Command, tmp_path: Path) -> None:
    path = tmp_path / "same.mcap"
    images = [picture(translation(shift, 0), SIZE) for shift in (0, 3, 3.5, 3)]
    with BagWriter(path) as writer:
        for topic in ("/cam/image_raw", "/cam/image_stabilized"):
            writer.add_topic(topic_of(topic, IMAGE))
            for index, gray in enumerate(images):
                one = frame(gray, index)
                writer.write(topic, one.stamp_ns, one.stamp_ns, image_cdr(gray, "mono8", header_of(one)))
    page = page_of(command, path)
    text = " ".join(page.text.split())
    assert "Nothing was gained: /cam/image_stabilized is displaced by" in text
    assert "headline compared bad" in page.source
    assert verdicts(page) == ["bad", "bad"]
    assert text.index("/cam/image_stabilized") < text.index("/cam/image_raw"), "the stabilised one first"


@pytest.mark.thorough
def test_raw_pictures_that_stand_still_leave_nothing_to_gain(command: Command, tmp_path: Path) -> None:
    path = tmp_path / "rest.mcap"
    with BagWriter(path) as writer:
        for topic in ("/cam/image_raw", "/cam/image_stabilized"):
            writer.add_topic(topic_of(topic, IMAGE))
            for index in range(3):
                one = frame(picture(IDENTITY, SIZE, noise=1.0 + 0.1 * index), index)
                writer.write(topic, one.stamp_ns, one.stamp_ns, image_cdr(one.image, "mono8", header_of(one)))
    page = page_of(command, path)
    assert "Both stand still" in page.text
    assert "Nothing was gained" not in page.text
    assert verdicts(page) == ["good", "good"]


def test_tables_name_measures_and_not_keys(report: Path) -> None:
    page = Page(report / "index.html")
    table = page.source.partition('<section id="measures">')[2].partition("</section>")[0]
    assert "displacement from the reference" in table
    assert "displacement_reference_px<" not in table
    for cell in re.findall(r"<td[^>]*>", page.source):
        assert "data-label" in cell or "words" in cell, "named where the head of the table is not shown"
    for pointer, text in page.numbers:
        if pointer.endswith(("/checkpoints/median", "/points_used/p95")):
            assert re.fullmatch(r"\d+|-", text), "counts have no decimals"
