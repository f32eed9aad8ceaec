"""`stab-ros compare`: its figures are those of `stabilize` and `evaluate`, and what fails is told in its row alone."""

from __future__ import annotations

import csv
import json
import multiprocessing
import re
import statistics
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import Command
from recordings import IMAGE_TOPIC, Entry, compressed, entries, write_mcap
from report_page import Page, decoded, looked_up
from truth import IDENTITY, frame, picture, random_noise, translation

from stab_ros import __version__
from stab_ros.core.errors import InputError
from stab_ros.core.geometry import rms_distance
from stab_ros.core.types import Gray, State, Track
from stab_ros.evaluation.comparison_summary import method_json
from stab_ros.io.bag import BagWriter, topic_of
from stab_ros.io.cdr import IMAGE, header_of
from stab_ros.io.homographies import HomographyWriter, read_homographies
from stab_ros.io.image_message import image_cdr
from stab_ros.jobs.compare import ComparisonJob, checked_methods, compare, known_methods
from stab_ros.jobs.compare_child import Failed, Finished, Run, Step, steps_of
from stab_ros.jobs.compare_outputs import writers_of
from stab_ros.jobs.compare_text import as_text
from stab_ros.jobs.compare_truth import Truth
from stab_ros.report.numbers import shown
from stab_ros.synthetic.flight import Shot

SIZE = (480, 360)
METHODS = ("direct", "klt")
JUDGED = ("displacement_reference_px", "displacement_previous_px", "rmse_reference_px", "rmsd_reference", "jitter_px",
          "drift_px")


def write_truth(path: Path, shots: list[Shot]) -> Path:
    with HomographyWriter(path) as table:
        for number, shot in enumerate(shots):
            table.write(number, Track(State.TRACKED, number, shot.stamp_ns, 0, 0, ref_H_cur=shot.ref_H_cur))
    return path


@pytest.fixture(scope="module")
def bag(flight: list[Shot], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The small flight as it was taken, with its truth beside it."""
    folder = tmp_path_factory.mktemp("compare")
    write_truth(folder / "truth.csv", flight)
    return write_mcap(folder / "raw.mcap", list(entries(flight)))


@pytest.fixture(scope="module")
def report(bag: Path, executable: Command) -> Path:
    """Of all figures of both methods over the flight."""
    done = executable("compare", bag, "--methods", ",".join(METHODS), "--truth", bag.parent / "truth.csv",
                      "--report", bag.parent / "report", "-p", "rmse_every:=3")
    assert done.returncode == 0, done.stderr
    assert done.stderr == "", "no progress bar in a pipe"
    return bag.parent / "report"


@pytest.fixture(scope="module")
def found(report: Path) -> dict[str, Any]:
    tree: dict[str, Any] = json.loads((report / "metrics.json").read_text(encoding="utf-8"))
    return tree


def compared(command: Command, path: Path, *options: object) -> tuple[dict[str, Any], str]:
    """The JSON and what was said of a command that must succeed."""
    done = command("compare", path, "--json", path.parent / "out.json", "--force", *options)
    assert done.returncode == 0, done.stderr
    return json.loads((path.parent / "out.json").read_text(encoding="utf-8")), done.stdout + done.stderr


def test_the_contract(found: dict[str, Any]) -> None:
    assert found["frames"] == 10
    assert list(found["methods"]) == list(METHODS)
    for method in found["methods"].values():
        assert (method["tracked"], method["lost"], method["failure"]) == (10, 0, None)
        assert set(method["error_px"]) >= {"median", "p95", "max"}
        assert method["error_px"]["count"] == 9, "without the reference"
        assert 0 < method["s_per_frame"] <= method["s_per_frame_p95"] < method["s_total"]
        assert method["s_per_frame"] == statistics.median([row["seconds"] for row in method["per_frame"][1:]])
        assert 50 < method["peak_mb"] < 2000
        assert method["matches"] >= method["inliers"] >= 12


@pytest.mark.parametrize("method", METHODS)
def test_homographies_and_errors_are_those_of_stabilize(method: str, found: dict[str, Any], bag: Path,
                                                        flight: list[Shot], command: Command, tmp_path: Path) -> None:
    done = command("stabilize", bag, tmp_path / "out.mcap", "--homographies", tmp_path / "H.csv", "-p",
                   f"method:={method}", "--no-image")
    assert done.returncode == 0, done.stderr
    rows = read_homographies(tmp_path / "H.csv")
    size = (flight[0].image.shape[1], flight[0].image.shape[0])
    expected = [rms_distance(row.ref_H_cur, shot.ref_H_cur, size) for row, shot in zip(rows, flight, strict=True)
                if row.ref_H_cur is not None]
    figures = found["methods"][method]
    assert [row["error_px"] for row in figures["per_frame"][1:]] == pytest.approx(expected[1:], abs=1e-9)
    assert figures["per_frame"][0]["error_px"] is None, "the reference"
    told = [figures["error_px"][key] for key in ("median", "p95", "max")]
    assert told == pytest.approx([*np.percentile(expected[1:], [50, 95]), max(expected[1:])], abs=1e-9)


@pytest.mark.parametrize("method", METHODS)
def test_the_judge_is_that_of_evaluate(method: str, found: dict[str, Any], bag: Path, command: Command,
                                       tmp_path: Path) -> None:
    done = command("stabilize", bag, tmp_path / "both.mcap", "--keep-raw", "-p", f"method:={method}")
    assert done.returncode == 0, done.stderr
    done = command("evaluate", tmp_path / "both.mcap", "--json", tmp_path / "J.json", "-p", "rmse_every:=3")
    assert done.returncode == 0, done.stderr
    topics = json.loads((tmp_path / "J.json").read_text(encoding="utf-8"))["topics"]
    for name in JUDGED:
        assert found["methods"][method][name] == topics["/cam/image_stabilized"][name], name
        assert found["raw"][name] == topics[IMAGE_TOPIC][name], name


def test_raw_is_told_beside_the_methods(found: dict[str, Any], flight: list[Shot]) -> None:
    size = (flight[0].image.shape[1], flight[0].image.shape[0])
    moved = [rms_distance(shot.ref_H_cur, IDENTITY, size) for shot in flight[1:]]
    assert found["raw"]["error_px"]["max"] == pytest.approx(max(moved))
    assert "s_per_frame" not in found["raw"]


def test_the_table_of_frames_holds_the_same(report: Path, found: dict[str, Any]) -> None:
    with (report / "metrics.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["method"] for row in rows] == ["raw"] * 10 + ["direct"] * 10 + ["klt"] * 10
    for cells in rows[10:]:
        of_json = found["methods"][cells["method"]]["per_frame"][int(cells["frame"])]
        for name in ("error_px", "rmse_px", "sigma_px", "seconds", "displacement_reference_px", "rmse_reference_px"):
            assert cells[name] == ("" if of_json[name] is None else repr(float(of_json[name])))
        assert (cells["status"], cells["inliers"]) == ("TRACKED", str(of_json["inliers"]))


@pytest.mark.thorough
def test_one_table_shows_all_and_the_same_twice(bag: Path, command: Command) -> None:
    options = ("--limit", 4, "--methods", ",".join(METHODS))
    one, said = compared(command, bag, *options)
    two, _ = compared(command, bag, *options)
    assert checked_methods(None) == known_methods(), "all there are"
    assert set(METHODS) <= set(known_methods())
    assert "error" not in said.partition("\n")[0]
    assert "error_px" not in one["methods"]["direct"]
    for name in METHODS:
        line = next(line for line in said.splitlines() if line.startswith(name)).split()
        figures = one["methods"][name]
        assert line[1:3] == ["4", "0"]
        assert line[3] == shown(figures["displacement_reference_px"]["median"])
        assert line[-2:] == [str(figures["matches"]), str(figures["inliers"])]
        for again in JUDGED:
            assert figures[again] == two["methods"][name][again]


@pytest.mark.thorough
def test_parameters_apply_to_all_methods_and_to_the_judge(bag: Path, command: Command, tmp_path: Path) -> None:
    config = tmp_path / "tracker.yaml"
    config.write_text("/**:\n  ros__parameters:\n    method: klt\n    model: translation\n", encoding="utf-8")
    points = tmp_path / "points.csv"
    points.write_text("name,x,y\nrock,100,60\n", encoding="utf-8")
    found, _ = compared(command, bag, "--methods", ",".join(METHODS), "--config", config, "--truth",
                        bag.parent / "truth.csv", "--points", points, "-p", "rmse_every:=1",
                        "-p", "max_sigma:=100.0", "-p", "threshold:=10.0")
    for method in found["methods"].values():
        assert method["error_px"]["median"] > 0.2, "a translation is too little"
        assert method["points_used"]["max"] <= 1
        assert method["rmse_reference_px"]["count"] == method["tracked"] - 1


@pytest.mark.parametrize(("options", "said"), [
    (["--methods", "direct,kld"], "--methods: 'kld' is unknown, did you mean klt"),
    (["--methods", "direct,,klt"], "must be names between commas"),
    (["-p", "method:=klt"], "name them with --methods"),
    (["-p", "modell:=affine"], "parameter 'modell' is unknown, did you mean model"),
    (["-p", "klt.corners:=-3"], "klt.corners"),
    (["--study", "models", "--methods", "direct,klt"], "takes the matches of one method"),
    (["--study", "models", "--methods", "klt", "--report", "R"], "does not go with --study"),
    (["--truth", "no.csv"], "no.csv: No such file"),
    (["--points", "no.csv"], "no.csv: No such file"),
    (["--image-topic", "/other"], "has no image topic /other"),
    (["-p", 'roi:=[[[0,0],[5,0],[5000,5]]]', "-p", "exclude:=[[[-9,-9],[5000,-9],[5000,5000],[-9,5000]]]"], "exclude"),
])
def test_what_cannot_be_used_is_one_line(options: list[str], said: str, bag: Path, command: Command) -> None:
    done = command("compare", bag, "--limit", 2, *options)
    assert done.returncode == 2
    assert said in done.stderr
    assert done.stderr.count("\n") == 1
    assert done.stdout == ""


def test_unknown_methods_are_refused_before_anything_is_read(command: Command, tmp_path: Path) -> None:
    done = command("compare", tmp_path / "nothing.mcap", "--methods", "ditrect")
    assert done.returncode == 2
    assert "did you mean direct" in done.stderr


@pytest.mark.parametrize(("rows", "said"), [
    (slice(0, 5), "does not fit raw.mcap, it has no row for frame 5; it must have one for each of 10 frames"),
    (slice(1, 10), "no row for frame 0"), (slice(0, 0), "holds no homography")])
def test_a_truth_that_does_not_fit(rows: slice, said: str, bag: Path, command: Command, tmp_path: Path) -> None:
    head, *lines = (bag.parent / "truth.csv").read_text(encoding="utf-8").splitlines()
    (tmp_path / "T.csv").write_text("\n".join([head, *lines[rows]]) + "\n", encoding="utf-8")
    done = command("compare", bag, "--truth", tmp_path / "T.csv")
    assert done.returncode == 2
    assert said in done.stderr
    assert done.stderr.count("\n") == 1


def test_a_truth_with_a_frame_twice_or_unknown_ones(bag: Path, flight: list[Shot], command: Command,
                                                    tmp_path: Path) -> None:
    head, *lines = (bag.parent / "truth.csv").read_text(encoding="utf-8").splitlines()
    (tmp_path / "twice.csv").write_text("\n".join([head, *lines, lines[3]]) + "\n", encoding="utf-8")
    with pytest.raises(InputError, match="has frame 3 twice"):
        Truth(tmp_path / "twice.csv")
    lines[2] = f"2,{flight[2].stamp_ns},LOST,,,,,,,,,,,,,,"
    (tmp_path / "gap.csv").write_text("\n".join([head, *lines]) + "\n", encoding="utf-8")
    found, _ = compared(command, bag, "--truth", tmp_path / "gap.csv", "--limit", 4, "--methods", "direct")
    assert [row["error_px"] is None for row in found["methods"]["direct"]["per_frame"]] == [True, False, True, False]


def test_the_error_is_against_the_methods_own_reference(flight: list[Shot], bag: Path) -> None:
    truth, size = Truth(bag.parent / "truth.csv"), (480, 270)
    exact = np.linalg.inv(flight[2].ref_H_cur) @ flight[5].ref_H_cur
    error_px = truth.error_px(5, 2, exact / exact[2, 2], size)
    assert error_px == pytest.approx(0, abs=1e-9)
    assert truth.error_px(5, 0, exact / exact[2, 2], size) == pytest.approx(
        rms_distance(exact / exact[2, 2], flight[5].ref_H_cur, size))


def written(path: Path, images: list[Gray]) -> Path:
    with BagWriter(path) as writer:
        writer.add_topic(topic_of("/cam/image_raw", IMAGE))
        for index, gray in enumerate(images):
            one = frame(gray, index)
            writer.write("/cam/image_raw", one.stamp_ns, one.stamp_ns, image_cdr(gray, "mono8", header_of(one)))
    return path


@pytest.mark.thorough
def test_lost_frames_are_counted_and_left_out(command: Command, tmp_path: Path) -> None:
    images = [picture(translation(0.7 * index, 0), SIZE) for index in range(5)]
    images[2] = random_noise(size=SIZE)
    path = written(tmp_path / "lost.mcap", images)
    with HomographyWriter(tmp_path / "T.csv") as table:
        for index in range(5):
            table.write(index, Track(State.TRACKED, index, frame(images[index], index).stamp_ns, 0, 0,
                                     ref_H_cur=translation(0.7 * index, 0)))
    found, said = compared(command, path, "--truth", tmp_path / "T.csv", "--report", tmp_path / "report", "--methods",
                           ",".join(METHODS))
    for method in found["methods"].values():
        assert (method["tracked"], method["lost"]) == (4, 1)
        assert method["error_px"]["count"] == method["sigma_px"]["count"] == 3
        assert method["error_px"]["max"] < 0.1
        assert method["displacement_reference_px"]["count"] == 3
        assert [row["status"] for row in method["per_frame"]] == ["TRACKED", "TRACKED", "LOST", "TRACKED", "TRACKED"]
    page = Page(tmp_path / "report" / "index.html")
    assert "Ticks at the bottom, in the colour of the method" in page.text
    assert "Lost frames:" in page.text
    assert "warning" not in said


@pytest.mark.thorough
def test_a_picture_that_cannot_be_decoded_costs_itself(flight: list[Shot], command: Command, tmp_path: Path) -> None:
    topic, msgtype = "/cam/image_raw/compressed", "sensor_msgs/msg/CompressedImage"
    messages = [Entry(topic, msgtype, shot.stamp_ns, compressed(shot, "png")) for shot in flight[:5]]
    messages[2].message.data = messages[2].message.data[:100]
    truth = write_truth(tmp_path / "T.csv", flight[:5])
    path = write_mcap(tmp_path / "in.mcap", messages)
    found, said = compared(command, path, "--truth", truth, "--methods", ",".join(METHODS))
    assert "1 of 5 images" in said
    for method in found["methods"].values():
        assert (method["tracked"], method["lost"]) == (4, 1)
        assert [row["frame"] for row in method["per_frame"]] == list(range(5))
        assert method["error_px"]["max"] < 0.1, "rows join by the number in the input"


def test_a_method_that_finds_no_reference(bag: Path, command: Command) -> None:
    found, said = compared(command, bag, "--limit", 3, "-p", "min_inliers:=9000", "--report", bag.parent / "none",
                           "--methods", "klt")
    method = found["methods"]["klt"]
    assert (method["tracked"], method["lost"], method["s_per_frame"]) == (0, 3, None)
    assert method["displacement_reference_px"]["count"] == 0
    assert re.search(r"^klt +0 +3 +- ", said, re.MULTILINE)
    assert "It aligned no frame" in Page(bag.parent / "none" / "index.html").text


def test_a_method_that_fails_is_a_row_that_says_why(bag: Path, tmp_path: Path) -> None:
    job = ComparisonJob(bag, ("klt", "no<b>such"), {}, {}, limit=3)
    told: list[tuple[int, int | None]] = []
    comparison = compare(job, lambda done, total: told.append((done, total)))
    good, bad = comparison.methods
    assert (good.tracked, good.failure) == (3, "")
    assert "'no<b>such' is unknown" in bad.failure
    assert method_json(bad, False)["tracked"] == 0
    assert "no<b>such: failed: " in as_text(comparison)
    assert told[-1] == (6, 9)
    writers_of(comparison, job, lambda *_: None).report(tmp_path)
    page = Page(tmp_path / "index.html")
    assert "no<b>such" in page.text
    assert "<b>" not in page.source


def test_a_process_that_dies_is_told(bag: Path) -> None:
    steps = steps_of(Run(bag, {"method": "klt"}))
    assert isinstance(next(steps), Step)
    (process,) = multiprocessing.active_children()
    process.kill()
    *_, last = steps
    assert last == Failed("its process was ended by SIGKILL")
    assert not multiprocessing.active_children()


@pytest.mark.thorough
def test_time_and_memory_are_the_methods_own(bag: Path, flight: list[Shot]) -> None:
    """This process holds far more than the children: nothing of it is counted."""
    ballast = np.ones(1_500_000_000, np.uint8)
    steps = list(steps_of(Run(bag, {"method": "klt"}, limit=4)))
    assert isinstance(steps[-1], Finished)
    assert 50 < steps[-1].peak_mb < ballast.nbytes / 2**20
    taken = [one for one in steps if isinstance(one, Step)]
    assert len(taken) == 4
    for one, shot in zip(taken, flight, strict=False):
        assert one.track.covariance is None
        assert one.steady is not None
        assert one.steady.image.shape == shot.image.shape
    assert not multiprocessing.active_children()


def test_leaving_early_leaves_no_process(bag: Path) -> None:
    steps = steps_of(Run(bag, {"method": "klt"}))
    next(steps)
    steps.close()
    assert not multiprocessing.active_children()


@pytest.mark.parametrize("kind", ["rosbag1", "folder", "video"])
def test_every_kind_of_input(kind: str, recordings: dict[str, Path], command: Command, tmp_path: Path) -> None:
    done = command("compare", recordings[kind], "--json", tmp_path / "J.json", "--methods", "direct", "--limit", 3)
    assert done.returncode == 0, done.stderr
    assert json.loads((tmp_path / "J.json").read_text(encoding="utf-8"))["methods"]["direct"]["tracked"] == 3


@pytest.mark.thorough
def test_colour_comes_through(flight: list[Shot], command: Command, tmp_path: Path) -> None:
    shots = [replace(shot, image=np.dstack([shot.image] * 3)) for shot in flight[:3]]
    found, _ = compared(command, write_mcap(tmp_path / "colour.mcap", list(entries(shots))), "--methods", "direct")
    steady, raw = (one["displacement_reference_px"]["median"] for one in (found["methods"]["direct"], found["raw"]))
    assert steady < 0.5 * raw


def test_outputs_are_not_overwritten(report: Path, bag: Path, command: Command) -> None:
    done = command("compare", bag, "--report", report)
    assert done.returncode == 2
    assert "--force" in done.stderr
    assert sorted(path.name for path in report.iterdir()) == ["index.html", "metrics.csv", "metrics.json"]


# the report


def test_every_number_in_the_text_is_that_of_the_json(report: Path, found: dict[str, Any]) -> None:
    page = Page(report / "index.html")
    embedded = json.loads(page.scripts["comparison"])
    assert embedded == found
    for pointer, text in page.numbers:
        assert text == shown(looked_up(embedded, pointer)), pointer
    told = {pointer for pointer, _ in page.numbers}
    for method in METHODS:
        for name in ("tracked", "error_px/median", "error_px/p95", "error_px/max", "displacement_reference_px/median",
                     "rmse_reference_px/median", "rmsd_reference/median", "jitter_px", "s_per_frame", "peak_mb",
                     "matches", "inliers"):
            assert f"/methods/{method}/{name}" in told


def test_there_are_no_other_numbers(report: Path) -> None:
    fixed = {"1.5", __version__}  # whiskers, and the software's version
    assert set(re.findall(r"\d+(?:\.\d+)+", Page(report / "index.html").unnumbered)) <= fixed


def test_it_is_one_file_with_every_figure(report: Path) -> None:
    page = Page(report / "index.html")
    assert all(link.startswith("data:") for link in page.links)
    text = re.sub(r"base64,[A-Za-z0-9+/=]+", "", page.source)
    assert not re.search(r"//[a-z]|@import|url\(", text)
    assert {"measures", "boxes", "series", "cost", "worst", "method"} <= set(page.ids)
    assert len(page.images) == 3 + 3 + 2 + 2 * len(METHODS)
    assert all(image.get("alt") for image in page.images)
    for image in page.images:
        pixels = decoded(image["src"] or "")
        assert min(pixels.shape[:2]) > 250
        assert pixels.std() > 5, "not empty"


def test_the_headline_names_the_best(report: Path, found: dict[str, Any]) -> None:
    text = " ".join(Page(report / "index.html").text.split())
    methods = found["methods"]
    exact = min(METHODS, key=lambda name: methods[name]["error_px"]["median"])
    quick = min(METHODS, key=lambda name: methods[name]["s_per_frame"])
    assert f"Most accurate: {exact} , off the truth by {shown(methods[exact]['error_px']['median'])} px" in text
    assert f"Quickest: {quick} , {shown(methods[quick]['s_per_frame'])} s a frame" in text


def test_the_worst_frame_is_shown_with_its_error(report: Path, found: dict[str, Any]) -> None:
    told = [pointer for pointer, _ in Page(report / "index.html").numbers if "/per_frame/" in pointer]
    worst = [max(range(1, 10), key=lambda at: method["per_frame"][at]["error_px"])
             for method in found["methods"].values()]
    assert told == [f"/methods/{name}/per_frame/{at}/error_px" for name, at in zip(METHODS, worst, strict=True)]


# the studies


def test_models_are_fitted_to_the_same_matches(bag: Path, command: Command, tmp_path: Path) -> None:
    done = command("compare", bag, "--study", "models", "--methods", "klt", "-p", "estimator:=ransac", "--json",
                   tmp_path / "S.json")
    assert done.returncode == 0, done.stderr
    study = json.loads((tmp_path / "S.json").read_text(encoding="utf-8"))
    assert (study["frames"], study["pairs"], study["method"]) == (10, 9, "klt")
    rows = study["models"]
    assert list(rows) == ["affine", "perspective", "similarity"]
    for row in rows.values():
        assert row["pairs"] == 9
        assert 12 <= row["final_points"] <= study["matches"]
        assert 0 < row["rmse_min_px"] <= row["rmse_median_px"] <= row["rmse_max_px"]
    assert re.search(r"^perspective +(-|\d+) +\d+ +(-|[\d.]+) +[\d.]+ +9$", done.stdout, re.MULTILINE)
