"""`stab-ros stabilize` tells once what share of the picture is fixed to the camera, and that is no warning."""

from __future__ import annotations

import re
from pathlib import Path

import cv2
import numpy as np
import pytest
from conftest import Command
from stabilised import homography, run, table
from truth import letterboxed, picture, translation


@pytest.mark.parametrize("start_s", [0.0, 1.0])
def test_bars_with_text_are_noted_and_not_followed(start_s: float, command: Command, tmp_path: Path) -> None:
    (tmp_path / "frames").mkdir()
    for number, image in enumerate(letterboxed(40)):
        cv2.imwrite(str(tmp_path / "frames" / f"{number:03}.png"), image)
    _, err = run(command, tmp_path / "frames", tmp_path / "out.mcap", "--homographies", tmp_path / "H.csv", "-p",
                 f"start_s:={start_s}")
    (note,) = [line for line in err.splitlines() if "fixed to the camera" in line]
    assert note.startswith("stab-ros: note: ")
    share = re.search(r"([\d.]+) % of the picture", note)
    assert share is not None
    assert 0.5 < float(share[1]) < 35
    H = homography(table(tmp_path / "H.csv")[-1])
    np.testing.assert_allclose(H[:2, 2], (25 * np.sin(39 / 6), 12 * np.sin(39 / 4)), atol=0.1)


def test_a_picture_without_an_overlay_has_no_note(command: Command, tmp_path: Path) -> None:
    (tmp_path / "frames").mkdir()
    for number in range(40):
        image = picture(translation(25 * np.sin(number / 6), 12 * np.sin(number / 4)))
        cv2.imwrite(str(tmp_path / "frames" / f"{number:03}.png"), image)
    _, err = run(command, tmp_path / "frames", tmp_path / "out.mcap")
    assert "fixed to the camera" not in err
