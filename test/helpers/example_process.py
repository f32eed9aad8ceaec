"""The programs in examples/ as processes of their own."""

from __future__ import annotations

import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from live_graph import Graph

EXAMPLES = Path(__file__).parents[2] / "examples"


@contextmanager
def running(graph: Graph, name: str, *arguments: str) -> Iterator[None]:
    """The example as a process on the graph; it must end well."""
    words = [sys.executable, str(EXAMPLES / name), "--ros-args", *arguments]
    with subprocess.Popen(words, env=graph.environment, stderr=subprocess.PIPE, text=True) as process:
        try:
            yield
        finally:
            process.send_signal(signal.SIGINT)
            _, errors = process.communicate(timeout=60)
    assert "Traceback" not in errors, errors
