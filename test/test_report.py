"""The HTML report: its numbers are those of the JSON, it needs nothing from elsewhere, and it shows what happened."""

from __future__ import annotations

import base64
import json
import re
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from conftest import Command
from recordings import entries, write_mcap
from truth import IDENTITY, flat, frame, picture, translation

from stab_ros.core.synthetic import Shot
from stab_ros.core.types import Gray, Image
from stab_ros.io.bag import BagWriter, topic_of
from stab_ros.io.messages import IMAGE, header_of, image_cdr
from stab_ros.report.numbers import shown
from stab_ros.report.overlay import edges, overlaid

SIZE = (480, 360)
SECTIONS = ("boxes", "series", "field", "motion", "worst", "calibration")


class Page(HTMLParser):
    """What a browser would make of it."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.source = path.read_text(encoding="utf-8")
        self.images: list[dict[str, str | None]] = []
        self.numbers: list[tuple[str, str]] = []  # JSON pointer and text
        self.links: list[str] = []
        self.ids: list[str] = []
        self.text = ""
        self.scripts: dict[str, str] = {}
        self._stack: list[tuple[str, dict[str, str | None]]] = []
        self.feed(self.source)
        assert not self._stack, "every element is closed"

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        of = dict(attrs)
        self.ids += [of["id"] or ""] if "id" in of else []
        self.links += [value or "" for name, value in attrs if name in ("src", "href", "action", "data")]
        if tag == "img":
            self.images.append(of)
        if tag not in ("img", "meta", "link", "input", "br"):
            self._stack.append((tag, of))

    def handle_endtag(self, tag: str) -> None:
        assert self._stack.pop()[0] == tag

    def handle_data(self, data: str) -> None:
        tag, of = self._stack[-1] if self._stack else ("", {})
        if tag == "script":
            self.scripts[of.get("id") or ""] = data
        elif tag != "style":
            self.text += " " + data
            pointer = of.get("data-pointer")
            if pointer is not None:
                self.numbers.append((pointer, data))


def looked_up(tree: Any, pointer: str) -> Any:
    """RFC 6901."""
    for step in pointer.split("/")[1:]:
        name = step.replace("~1", "/").replace("~0", "~")
        tree = tree[int(name)] if isinstance(tree, list) else tree[name]
    return tree


@pytest.fixture(scope="module")
def report(flight: list[Shot], executable: Command, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Of a small flight, raw and stabilised."""
    folder = tmp_path_factory.mktemp("report")
    raw = write_mcap(folder / "raw.mcap", list(entries(flight)))
    done = executable("stabilize", raw, folder / "both.mcap", "--keep-raw")
    assert done.returncode == 0, done.stderr
    done = executable("evaluate", folder / "both.mcap", "--report", folder / "report", "-p", "gsd_m:=0.02",
                      "-p", "rmse_every:=2")
    assert done.returncode == 0, done.stderr
    return folder / "report"


def test_every_number_in_the_text_is_that_of_the_json(report: Path) -> None:
    page, beside = Page(report / "index.html"), json.loads((report / "metrics.json").read_text(encoding="utf-8"))
    embedded = json.loads(page.scripts["evaluation"])
    assert embedded == beside
    assert len(page.numbers) > 200
    for pointer, text in page.numbers:
        value = looked_up(embedded, pointer)
        assert text == shown(value), pointer
        if isinstance(value, float):
            assert float(text) == pytest.approx(value, abs=0.00051), pointer
    told = {pointer for pointer, _ in page.numbers}
    for topic in ("~1cam~1image_raw", "~1cam~1image_stabilized"):
        for name in ("rmsd_reference", "displacement_previous_px", "rmse_reference_px", "velocity_error_m_s"):
            assert {f"/topics/{topic}/{name}/{key}" for key in ("median", "p95", "max", "count")} <= told


def test_numbers_of_the_worst_frames_are_those_of_the_json(report: Path) -> None:
    page = Page(report / "index.html")
    rows = [row for topic in json.loads(page.scripts["evaluation"])["topics"].values() for row in topic["per_frame"]]
    told = re.findall(r"displaced by ([\d.]+) px, (?:RMSE [\d.]+ px, )?RMSD ([\d.]+) grey levels", page.text)
    assert len(told) == 6, "three of each stream"
    known = {(shown(row["displacement_reference_px"]), shown(row["rmsd_reference"])) for row in rows}
    assert set(told) <= known


@pytest.mark.parametrize(("value", "text"), [
    (None, "-"), (3, "3"), (3.0, "3"), (1.23456, "1.235"), (-0.04, "-0.040"), (0.00084, "0.00084"), (0.0, "0"),
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


def decoded(uri: str) -> Image:
    content = base64.b64decode(uri.partition("base64,")[2])
    return np.asarray(cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_COLOR))


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
    [picture(IDENTITY, SIZE), picture(translation(1, 0), SIZE)]], ids=["flat", "reference alone", "two frames"])
def test_where_there_is_little_it_says_so(images: list[Gray], command: Command, tmp_path: Path) -> None:
    page = page_of(command, written(tmp_path / "little.mcap", images))
    assert set(SECTIONS) <= set(page.ids)
    assert "nothing to draw" in page.text or "Too few frames" in page.text
    for pointer, text in page.numbers:
        assert text == shown(looked_up(json.loads(page.scripts["evaluation"]), pointer))


def test_names_are_no_markup(command: Command, tmp_path: Path) -> None:
    page = page_of(command, written(tmp_path / "a<b>&'c.mcap", [picture(IDENTITY, SIZE), picture(IDENTITY, SIZE)]))
    assert "a<b>&'c.mcap" in page.text
    assert "<b>" not in page.source


def test_a_brightness_change_is_told(command: Command, tmp_path: Path) -> None:
    images = [picture(IDENTITY, SIZE), picture(IDENTITY, SIZE, gain=1.05)]
    assert "brightness changed by +5" in page_of(command, written(tmp_path / "light.mcap", images)).text


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
