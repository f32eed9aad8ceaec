"""The demo where a node ends too early, and at another pace."""

from __future__ import annotations

import os
import signal
from pathlib import Path

from demo_process import processes_with, run, start, table, wait_for


def test_a_tracker_that_ends_is_named_and_what_was_recorded_is_judged(tmp_path: Path) -> None:
    folder, log = tmp_path / "demo_output", tmp_path / "demo_output" / "log" / "tracker_node.txt"
    with start(folder) as demo:
        wait_for(lambda: log.exists() and "ready" in log.read_text(), demo)
        for path in processes_with(str(folder)):
            if b"stab_ros.nodes.tracker\0" in path.with_name("cmdline").read_bytes():
                os.kill(int(path.parent.name), signal.SIGTERM)
        said, errors = demo.communicate(timeout=300)
    assert demo.returncode == 1
    assert errors.startswith("demo: tracker_node ended with code 0 before the flight was over; its last words: ")
    assert "got no answer: " in errors
    assert said.splitlines()[-2].startswith(f"open first: {folder / 'errors.txt'}")
    assert len(table(folder)) == 72
    assert not processes_with(str(folder))


def test_the_rate_of_the_player_changes_nothing(tmp_path: Path) -> None:
    """One of the promises that the demo checks is that all homographies are the command's, to 1e-9."""
    done = run(tmp_path, "--rate", "4")
    assert (done.returncode, done.stderr) == (0, "")
    assert "live homographies are those of `stab-ros stabilize`, to 1e-09" in done.stdout
