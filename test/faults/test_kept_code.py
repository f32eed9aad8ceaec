"""Compiled kernels that cannot be kept, or not be read again: that costs time, and changes no homography."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ailing import needs_root, run

import stab_ros

ROOT = Path(stab_ros.__file__).parents[1]
TESTS = Path(__file__).parents[1]
NOWHERE = {"HOME": "/proc/1/nowhere", "XDG_CACHE_HOME": "/proc/1/nowhere"}
PROGRAM = """
import json, sys
sys.path.insert(0, sys.argv[1])
from test_kernels import seen
from stab_ros.core.kernels import compile_kernels
from stab_ros.io.engine import make_stabilizer
done, stabilizer = compile_kernels(), make_stabilizer({})
tracks = [track for number in range(8) for track in stabilizer.answers(seen(number))] + stabilizer.finish()
print(json.dumps([done.compiled, done.trouble, [track.ref_H_cur.tolist() for track in tracks]]))
"""


def answered(package: Path, **environment: str) -> tuple[int, str, list[list[float]]]:
    """How many kernels another process had to compile, why they cannot be kept, and its homographies."""
    words = [sys.executable, "-c", PROGRAM, str(TESTS)]
    done = subprocess.run(words, cwd=package, env={**os.environ, "PYTHONPATH": str(package), **environment},
                          capture_output=True, text=True, timeout=300, check=True)
    compiled, trouble, homographies = json.loads(done.stdout)
    return compiled, trouble, homographies


def test_fresh_kept_and_damaged_code_give_the_same(tmp_path: Path) -> None:
    """The first start, the second, and one after the power failed while the code was written."""
    cache = str(tmp_path / "cache")
    fresh, kept = (answered(ROOT, NUMBA_CACHE_DIR=cache) for _ in range(2))
    assert fresh[0] > 20
    assert (fresh[1], kept[0], kept[1]) == ("", 0, "")
    files = sorted(Path(cache).rglob("*.nbc"))
    files[0].write_bytes(files[0].read_bytes()[:100])
    files[-1].write_bytes(b"")
    damaged = answered(ROOT, NUMBA_CACHE_DIR=cache)
    assert 0 < damaged[0] <= 2
    assert damaged[1]
    assert fresh[2] == kept[2] == damaged[2]


def test_code_that_cannot_be_kept_costs_time_alone(tmp_path: Path) -> None:
    """A service user without a home, and a package that nobody may write beside."""
    shutil.copytree(ROOT / "stab_ros", tmp_path / "stab_ros", ignore=shutil.ignore_patterns("__pycache__"))
    for folder in [path for path in (tmp_path / "stab_ros").rglob("*") if path.is_dir()]:
        (folder / "__pycache__").write_text("taken")  # as root, no permission would keep anybody from writing
    compiled, trouble, homographies = answered(tmp_path, **NOWHERE)
    assert compiled > 20
    assert "cannot cache" in trouble
    assert homographies == answered(ROOT)[2]


@contextmanager
def read_only(folder: Path) -> Iterator[None]:
    run("mount", "--bind", folder, folder)
    try:
        run("mount", "-o", "remount,ro,bind", folder)
        yield
    finally:
        run("umount", folder)


def warmed_up(package: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-m", "stab_ros", "warm-up"], cwd=package, capture_output=True, text=True,
                          env={**os.environ, "PYTHONPATH": str(package), **environment}, timeout=300, check=True)


@needs_root
def test_code_that_was_kept_is_found_where_it_cannot_be_written(tmp_path: Path) -> None:
    package = tmp_path / "package"
    shutil.copytree(ROOT / "stab_ros", package / "stab_ros", ignore=shutil.ignore_patterns("__pycache__"))
    assert ", of which 0 were compiled" not in warmed_up(package).stdout
    with read_only(package):
        done = warmed_up(package, **NOWHERE)
        assert ", of which 0 were compiled" in done.stdout
        assert not done.stderr

    changed = package / "stab_ros" / "methods" / "_spread.py"
    changed.write_text(changed.read_text(encoding="utf-8") + "\n", encoding="utf-8")
    with read_only(package):
        done = warmed_up(package, **NOWHERE)
        assert ", of which 1 were compiled" in done.stdout
        assert "compiled kernels cannot be kept" in done.stderr
        assert "NUMBA_CACHE_DIR" in done.stderr
