"""What several tests share: a small flight with its truth, its recordings in every format, and the command line."""

from __future__ import annotations

import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import settings
from recordings import RECORDERS
from repeated_cases import ONE_CASE, USUAL_METHODS

from stab_ros.cli import main
from stab_ros.synthetic.flight import Flight, Shot, preset

if TYPE_CHECKING:
    from live_graph import Graph

SIZE = (480, 270)
FRAMES = 10
SHARED_DATA = Path(__file__).resolve().parents[2] / "shared" / "data"

# A runner in the background (nohup, `&`) ignores SIGINT, and children inherit that; some tests send it to them.
signal.signal(signal.SIGINT, signal.default_int_handler)

settings.register_profile("the same examples in every run", derandomize=True)
settings.load_profile("the same examples in every run")

Command = Callable[..., "subprocess.CompletedProcess[str]"]

_LIVE = {"demo", "examples", "faults"}  # folders of tests that start nodes
_SLOW = {  # files with long flights, all methods at once, or whole reports
    "test_cli", "test_compare", "test_descriptors", "test_ecc", "test_estimators", "test_evaluate", "test_homologous",
    "test_kernels", "test_keyframes", "test_lies", "test_parallax", "test_pause", "test_real_video", "test_recovery",
    "test_references", "test_report", "test_rolling_shutter", "test_sar_sift", "test_search", "test_static_ground",
    "test_succession",
    "test_synthetic", "test_uncertainty",
}
_FAST = "not (dds or big or slow or thorough)"  # as `make test-fast`
_QUICK_METHODS = {"direct"}  # which stands for all methods while one works


def pytest_configure(config: pytest.Config) -> None:
    """`colcon test` runs the fast tests; `--pytest-args -m ...` others."""
    if config.option.junitprefix == "stab_ros" and not config.option.markexpr:  # colcon names its results so
        config.option.markexpr = _FAST


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Marks what joins a ROS graph, what needs real videos and what takes long, by fixture, folder, file and method."""
    shown: set[tuple[Path, str]] = set()  # tests of which the first case has been met
    for item in items:
        fixtures = getattr(item, "fixturenames", ())
        parameters = getattr(getattr(item, "callspec", None), "params", {})
        if {"graph", "make_node"} & {*fixtures} or item.path.parent.name in _LIVE:
            item.add_marker(pytest.mark.dds)
        if "shared_data" in fixtures:
            item.add_marker(pytest.mark.big)
        method = parameters.get("method", "direct")
        test = item.path, getattr(item, "originalname", item.name)
        repeated = test in shown and test[1] in ONE_CASE
        shown.add(test)
        if repeated or (item.path.stem == "test_contract" and method not in USUAL_METHODS):
            item.add_marker(pytest.mark.thorough)
        if item.path.stem in _SLOW or method not in _QUICK_METHODS:
            item.add_marker(pytest.mark.slow)
    waiting = {item.path for item in items if item.get_closest_marker("dds")}
    place = _places([*dict.fromkeys(item.path for item in items)], waiting)
    items.sort(key=lambda item: place[item.path])


def _places(paths: list[Path], waiting: set[Path]) -> dict[Path, float]:
    """Where each file stands: those of nodes, which wait for each other, among the first 3/4 of those that compute."""
    kinds = [path for path in paths if path in waiting], [path for path in paths if path not in waiting]
    return {path: share * number / len(kind) for share, kind in zip((0.75, 1.0), kinds, strict=True)
            for number, path in enumerate(kind)}


@pytest.fixture(scope="session")
def flight() -> list[Shot]:
    """Ten grey frames of 480x270 over an alpine river, with the true `ref_H_cur` of each."""
    return list(Flight(preset("alpine"), size=SIZE, frames=FRAMES, seed=3))


@pytest.fixture(scope="session")
def recordings(flight: list[Shot], tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """The flight as mcap, rosbag2_mcap, rosbag2_sqlite3, rosbag1, folder and video; not to be written to."""
    folder = tmp_path_factory.mktemp("recordings")
    return {kind: record(folder, flight) for kind, record in RECORDERS.items()}


@pytest.fixture
def command(capfd: pytest.CaptureFixture[str]) -> Command:
    """Runs `stab-ros` with these arguments in this process, which need not load every library anew as `executable`."""

    def run(*arguments: object) -> subprocess.CompletedProcess[str]:
        words = [*map(str, arguments)]
        capfd.readouterr()
        try:
            code: Any = main(words)
        except SystemExit as end:  # wrong usage
            code = end.code
        return subprocess.CompletedProcess(words, code, *capfd.readouterr())  # what C libraries say too

    return run


@pytest.fixture(scope="session")
def executable() -> Command:
    """Runs `python -m stab_ros` with these arguments in a process of its own, in the folder `cwd`."""

    def run(*arguments: object, cwd: Path | None = None, timeout_s: float = 300) -> subprocess.CompletedProcess[str]:
        words = [sys.executable, "-m", "stab_ros", *map(str, arguments)]
        return subprocess.run(words, cwd=cwd, capture_output=True, text=True, timeout=timeout_s, check=False)

    return run


@pytest.fixture
def graph(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Graph]:
    """A ROS graph on a domain of its own, whose nodes log to `tmp_path`; messages are checked as they are filled."""
    from live_graph import graph_in  # the other tests do without ROS

    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    monkeypatch.setenv("ROS_PYTHON_CHECK_FIELDS", "1")
    with graph_in(tmp_path) as graph:
        yield graph


@pytest.fixture
def shared_data() -> Path:
    """The folder of real data beside the repository; the test is skipped where there is none."""
    if not SHARED_DATA.is_dir():
        pytest.skip("no real data beside the repository")
    return SHARED_DATA
