"""The demo as the user runs it: real processes over DDS, on the recorded flight."""

from __future__ import annotations

import csv
import signal
import subprocess
import sys
import time
from pathlib import Path

import cv2
import pytest

WORDS = [sys.executable, "-m", "stab_ros.demo"]


def test_demo_shows_the_result_and_its_error(tmp_path: Path) -> None:
    folder = tmp_path / "demo_output"
    done = subprocess.run([*WORDS, str(folder)], capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stderr
    made = ("stabilized.mcap", "H.csv", "before_after.mp4", "before_after.png", "errors.txt", "report/index.html")
    assert all(str(folder / name) in done.stdout and (folder / name).stat().st_size for name in made)
    assert float(done.stdout.split("the measures differ by ")[1].split()[0]) < 1e-6
    assert "72 of 72 frames answered, 72 tracked, 49 pictures" in done.stdout
    median, p95, largest = (float(word) for word in done.stdout.split("\nstabilised ")[1].split()[:3])
    assert median <= p95 <= largest < 0.05
    with (folder / "H.csv").open(encoding="utf-8", newline="") as file:
        assert [row["status"] for row in csv.DictReader(file)] == ["TRACKED"] * 72
    assert cv2.VideoCapture(str(folder / "before_after.mp4")).get(cv2.CAP_PROP_FRAME_COUNT) == 49


@pytest.mark.parametrize("delay_s", [0.0, 0.5])  # while the tracker's process is being made, and later
def test_interrupted_demo_leaves_no_process(tmp_path: Path, delay_s: float) -> None:
    folder = tmp_path / "demo_output"
    with subprocess.Popen([*WORDS, str(folder)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as demo:
        while not (folder / "log" / "tracker_node.txt").exists():
            assert demo.poll() is None
            time.sleep(0.0005)
        time.sleep(delay_s)
        demo.send_signal(signal.SIGTERM)
        _, said = demo.communicate(timeout=60)
    assert (demo.returncode, said) == (130, "demo: interrupted\n")
    assert not processes_with(str(folder))


def processes_with(word: str) -> list[Path]:
    """Those that have it in their environment, as all nodes of a demo have its folder (ROS_LOG_DIR)."""
    return [path for path in Path("/proc").glob("[0-9]*/environ") if word in environment(path)]


def environment(path: Path) -> str:
    try:
        return path.read_text(errors="replace")
    except OSError:  # it has ended meanwhile, or is somebody else's
        return ""


def test_a_folder_that_cannot_be_made_is_one_line(tmp_path: Path) -> None:
    taken = tmp_path / "taken"
    taken.write_text("a file")
    done = subprocess.run([*WORDS, str(taken)], capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 1
    assert done.stderr == f"demo: {taken}: File exists\n"
