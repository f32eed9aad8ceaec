"""The first flight after an installation, when nothing has been compiled yet."""

from __future__ import annotations

from pathlib import Path

from live_graph import Graph
from test_live_starts import FRAMES, ImagePublisher


def test_a_first_flight_after_an_installation(graph: Graph, tmp_path: Path) -> None:
    """Everything is compiled before "ready", and nothing after it."""
    graph.environment["NUMBA_CACHE_DIR"] = str(tmp_path / "cache")
    camera = ImagePublisher(graph)
    kept = sorted((tmp_path / "cache").rglob("*.nbc"))
    camera.show(FRAMES)
    camera.check_engine()
    assert kept
    assert sorted((tmp_path / "cache").rglob("*.nbc")) == kept
    assert "compiled " in camera.tracker.log.partition("ready")[0]
