"""The demo in a process of its own, and the processes that it starts."""

from __future__ import annotations

import csv
import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

WORDS = [sys.executable, "-m", "stab_ros.demo"]


def run(folder: Path, *options: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([*WORDS, str(folder), *options], capture_output=True, text=True, timeout=600, check=False)


def table(folder: Path) -> list[dict[str, str]]:
    with (folder / "H.csv").open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def start(folder: Path, **environment: str) -> subprocess.Popen[str]:
    return subprocess.Popen([*WORDS, str(folder)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
                            env={**os.environ, **environment})


def wait_for(condition: Callable[[], object], demo: subprocess.Popen[str]) -> None:
    while not condition():
        assert demo.poll() is None
        time.sleep(0.0005)


def processes_with(word: str) -> list[Path]:
    """Those that have it in their environment, as all nodes of a demo have its folder (ROS_LOG_DIR)."""
    return [path for path in Path("/proc").glob("[0-9]*/environ") if word in environment(path)]


def environment(path: Path) -> str:
    try:
        return path.read_text(errors="replace")
    except OSError:  # it has ended meanwhile, or is somebody else's
        return ""
