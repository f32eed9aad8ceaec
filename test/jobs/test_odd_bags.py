"""`stab-ros stabilize` over bags as people have them: names that ROS does not allow, cameras that change."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from bag_makers import STRING
from conftest import Command
from recordings import Entry, camera_info, image, write_mcap
from stabilised import JAZZY, messages, run

from stab_ros.io.cdr import CAMERA_INFO, IMAGE
from stab_ros.synthetic.flight import Shot


@pytest.mark.parametrize(("topic", "namespace"), [
    ("/cam/image_raw/", "/cam"), ("/cam//image_raw", "/cam"), ("image_raw", ""), ("cam/image_raw", "cam"), ("/", ""),
    ("", ""), ("/my cam/Bild \u00e4", "/my cam")])
def test_names_that_ros_does_not_allow(
    topic: str, namespace: str, flight: list[Shot], command: Command, tmp_path: Path
) -> None:
    others = [Entry("/notes", STRING, 0, JAZZY.types[STRING]("a"))]
    images = [Entry(topic, IMAGE, shot.stamp_ns + 60 * 10**9, image(shot)) for shot in flight[:3]]  # they begin late
    write_mcap(tmp_path / "in.mcap", [*others, *images])
    out, err = run(command, tmp_path / "in.mcap", tmp_path / "out.mcap", "--no-image")
    assert "3 tracked" in out
    assert err == ""
    assert {name: len(found) for name, found in messages(tmp_path / "out.mcap").items()} == {
        f"{namespace}/homography": 3, f"{namespace}/track": 3, f"{namespace}/static_map": 1, "/notes": 1}
    told = command("info", tmp_path / "in.mcap").stdout
    assert f"  {topic}: 480x270 mono8" in told


@pytest.mark.parametrize("zoomed", [False, True])
def test_a_camera_that_changes_is_said(zoomed: bool, flight: list[Shot], command: Command, tmp_path: Path) -> None:
    entries = []
    for number, shot in enumerate(flight[:4]):
        K = np.array([[500.0 + 50 * (zoomed and number > 1), 0, 240], [0, 500, 135], [0, 0, 1]])
        info = camera_info(K, (-0.01, 0.0, 0.0, 0.0), (480, 270), shot.stamp_ns)
        entries += [Entry("/cam/camera_info", CAMERA_INFO, shot.stamp_ns, info),
                    Entry("/cam/image_raw", IMAGE, shot.stamp_ns, image(shot))]
    source = write_mcap(tmp_path / "in.mcap", entries)
    _, err = run(command, source, tmp_path / "out.mcap", "--no-image", "-p", "use_camera_info:=true")
    told = (f"stab-ros: warning: {source}: /cam/camera_info tells of another camera from {flight[2].stamp_ns} ns on, "
            "the camera of its first message was used for all images\n")
    assert err == (told if zoomed else "")
    assert run(command, source, tmp_path / "other.mcap", "--no-image")[1] == ""  # no matter where it is not used
