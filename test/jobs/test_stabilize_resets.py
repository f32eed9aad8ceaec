"""`stab-ros stabilize` where images change in kind: where homographies begin anew, and what is said of it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from conftest import Command
from recordings import entries, to_cdr, write_folder, write_mcap
from stabilised import decoded, errors_px, messages, rms_px, run, table
from truth import frame, picture, random_noise, translation

from stab_ros.core.types import Frame, Image, ResetReason
from stab_ros.io.advice import Reset, begun_anew
from stab_ros.parameters.engines import make_stabilizer
from stab_ros.synthetic.flight import Shot

TO: dict[str, Callable[[Image], Image]] = {
    "mono8": lambda grey: grey,
    "bgr8": lambda grey: np.asarray(cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR)),
    "bgra8": lambda grey: np.asarray(cv2.cvtColor(grey, cv2.COLOR_GRAY2BGRA)),
    "mono16": lambda grey: grey.astype(np.uint16) * 257,
}
MIXED = ["bgr8", "mono8", "bgra8", "bgr8", "bgr8", "mono8", "bgra8", "mono8", "bgr8", "bgr8"]


def in_encodings(shots: Sequence[Shot], encodings: Sequence[str]) -> list[Shot]:
    return [replace(shot, image=TO[encoding](shot.image)) for shot, encoding in zip(shots, encodings, strict=True)]


def bag_of(path: Path, shots: Sequence[Shot], encodings: Sequence[str]) -> Path:
    return write_mcap(path, list(entries(in_encodings(shots, encodings))))


@pytest.mark.parametrize("kind", ["folder", "bag"])
def test_grey_colour_and_alpha_are_one_camera(
    kind: str, flight: list[Shot], command: Command, tmp_path: Path
) -> None:
    if kind == "bag":
        source, topic = bag_of(tmp_path / "in.mcap", flight, MIXED), "/cam/image_stabilized"
    else:
        source = write_folder(tmp_path / "frames", in_encodings(flight, MIXED))
        topic = "/camera/image_stabilized"
    out, err = run(command, source, tmp_path / "out.mcap", "--homographies", tmp_path / "H.csv", "--video",
                   tmp_path / "V.mp4")
    assert (out.splitlines()[0].split(",")[0], err) == ("10 frames: 10 tracked", "")
    rows = table(tmp_path / "H.csv")
    assert {(row["reset_counter"], row["reset_reason"]) for row in rows} == {("0", "")}
    assert max(errors_px(rows, flight)) < 0.1
    made = [decoded(data, "sensor_msgs/msg/Image").encoding for _, data in messages(tmp_path / "out.mcap")[topic]]
    assert made == MIXED


def test_another_bit_depth_is_another_camera_and_said_with_its_frame(
    flight: list[Shot], command: Command, tmp_path: Path
) -> None:
    encodings = ["bgr8"] * 4 + ["mono16"] * 6
    bag = bag_of(tmp_path / "in.mcap", flight, encodings)
    _, err = run(command, bag, tmp_path / "out.mcap", "--homographies", tmp_path / "H.csv")
    rows = table(tmp_path / "H.csv")
    assert [row["reset_counter"] for row in rows] == list("0000111111")
    assert [row["reset_reason"] for row in rows] == [""] * 4 + ["other bit depth"] * 6
    assert err == (f"stab-ros: warning: {bag}: homographies begin anew at frame 4 (the images have another bit depth, "
                   "480x270 mono16); those of different reset_counter belong to different references or ground\n")
    begun = np.linalg.inv(flight[4].ref_H_cur)
    H = [np.array([float(row[f"h{i}{j}"]) for i in range(3) for j in range(3)]).reshape(3, 3) for row in rows]
    assert max(rms_px(H[k], begun @ flight[k].ref_H_cur, (480, 270)) for k in range(4, 10)) < 0.1


def test_many_resets_are_one_line(flight: list[Shot], command: Command, tmp_path: Path) -> None:
    bag = bag_of(tmp_path / "in.mcap", flight, ["mono8", "mono16"] * 5)
    _, err = run(command, bag, tmp_path / "out.mcap")
    assert len(err.splitlines()) == 1
    assert err.count("at frame") == 3
    assert "and at 6 more frames" in err


def test_a_damaged_first_picture_is_said_with_the_frame_that_took_its_place(
    flight: list[Shot], command: Command, tmp_path: Path
) -> None:
    snow = np.random.default_rng(1).integers(0, 256, flight[0].image.shape, np.uint8)
    folder = write_folder(tmp_path / "frames", [replace(flight[0], image=snow), *flight])
    _, err = run(command, folder, tmp_path / "out.mcap", "--homographies", tmp_path / "H.csv")
    rows = table(tmp_path / "H.csv")
    first = next(k for k, row in enumerate(rows) if row["reset_counter"] == "1" and row["status"] == "TRACKED")
    assert rows[first]["reset_reason"] == "reference matched nothing"
    assert f"at frame {first} (the reference before matched no image after it" in err


def test_an_undecodable_frame_belongs_to_the_reference_before_it(
    flight: list[Shot], command: Command, tmp_path: Path
) -> None:
    """Also where the start-up has run ahead into another reference."""
    recorded = list(entries(in_encodings(flight, ["mono8"] * 5 + ["mono16"] * 5)))
    recorded[4] = replace(recorded[4], message=to_cdr(recorded[4])[:-9])
    bag = write_mcap(tmp_path / "in.mcap", recorded)
    run(command, bag, tmp_path / "out.mcap", "--homographies", tmp_path / "H.csv")
    rows = table(tmp_path / "H.csv")
    assert [row["reset_counter"] for row in rows] == list("0000011111")
    assert rows[2]["lost_reason"] == "unusable image"


# --- the engine ------------------------------------------------------------------------------------------------------


def test_every_reset_has_its_reason() -> None:
    stabilizer = make_stabilizer({})
    tracks = [stabilizer.track(frame(picture(), 0)), stabilizer.track(frame(picture(translation(2, 1)), 1))]
    stabilizer.reset_reference()
    tracks += [stabilizer.track(frame(picture(), 2)), stabilizer.track(frame(picture()[:200].copy(), 3)),
               stabilizer.track(Frame(TO["mono16"](picture()[:200]), "mono16", 4)),
               stabilizer.track(Frame(TO["mono16"](random_noise(1)[:200]), "mono16", 5))]
    assert [track.reset_counter for track in tracks] == [0, 0, 1, 2, 3, 3]
    assert [track.reset_reason for track in tracks] == [
        None, None, ResetReason.ASKED, ResetReason.SIZE, ResetReason.DEPTH, ResetReason.DEPTH]


def test_what_is_said_of_resets() -> None:
    assert begun_anew([]) == ""
    assert "at frame 7 (another plane turned out to be the ground);" in begun_anew([Reset(7, ResetReason.GROUND, "")])
