"""Compiled kernels that cannot be kept, or not be read again: that costs time, and changes no homography."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ailing import needs_root
from two_hosts import run

import stab_ros
import stab_ros.parameters.engines  # all kernels
from stab_ros.core.kernels import KERNELS

ROOT = Path(stab_ros.__file__).parents[1]
HELPERS = Path(__file__).parents[1] / "helpers"
NOWHERE = {"HOME": "/proc/1/nowhere", "XDG_CACHE_HOME": "/proc/1/nowhere"}
PROGRAM = """
import json, sys
sys.path.insert(0, sys.argv[1])
from received import seen
from stab_ros.core.kernels import compile_kernels
from stab_ros.parameters.engines import make_stabilizer
done, stabilizer = compile_kernels(), make_stabilizer({})
tracks = [track for number in range(8) for track in stabilizer.answers(seen(number))] + stabilizer.finish()
print(json.dumps([done.compiled, done.trouble, [track.ref_H_cur.tolist() for track in tracks]]))
"""


def answered(package: Path, **environment: str) -> tuple[int, str, list[list[float]]]:
    """How many kernels another process had to compile, why they cannot be kept, and its homographies."""
    words = [sys.executable, "-c", PROGRAM, str(HELPERS)]
    done = subprocess.run(words, cwd=package, env={**os.environ, "PYTHONPATH": str(package), **environment},
                          capture_output=True, text=True, timeout=300, check=True)
    compiled, trouble, homographies = json.loads(done.stdout)
    return compiled, trouble, homographies


def test_fresh_kept_and_damaged_code_give_the_same(tmp_path: Path) -> None:
    """The first start, the second, and one after the power failed while the code was written."""
    cache = str(tmp_path / "cache")
    fresh, kept = (answered(ROOT, NUMBA_CACHE_DIR=cache) for _ in range(2))
    assert fresh[0] == len(KERNELS)
    assert (fresh[1], kept[0], kept[1]) == ("", 0, "")
    first, *_, last = sorted(Path(cache).rglob("*.nbc"))
    first.write_bytes(first.read_bytes()[:100])
    last.write_bytes(b"no LLVM" + last.read_bytes()[7:])
    damaged, mended = (answered(ROOT, NUMBA_CACHE_DIR=cache) for _ in range(2))
    assert (damaged[0], damaged[1], mended[0], mended[1]) == (2, "", 0, "")
    assert fresh[2] == kept[2] == damaged[2] == mended[2]


def test_an_interrupt_of_the_compiler_is_a_clean_end(tmp_path: Path) -> None:
    words = [sys.executable, "-m", "stab_ros", "warm-up"]
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    with subprocess.Popen(words, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        while len(list((tmp_path / "cache").rglob("*.nbc"))) < 5:
            time.sleep(0.02)
        process.send_signal(signal.SIGINT)
        said = process.communicate(timeout=120)
    assert process.returncode == 130
    assert said == ("", "stab-ros: interrupted; an unfinished output has .partial in its name\n")


def test_without_a_compiler_everything_is_there_to_be_debugged() -> None:
    assert answered(ROOT, NUMBA_DISABLE_JIT="1")[0] == 0


def test_code_that_cannot_be_kept_costs_time_alone(tmp_path: Path) -> None:
    """A service user without a home, and a package that nobody may write beside."""
    shutil.copytree(ROOT / "stab_ros", tmp_path / "stab_ros", ignore=shutil.ignore_patterns("__pycache__"))
    for folder in [path for path in (tmp_path / "stab_ros").rglob("*") if path.is_dir()]:
        (folder / "__pycache__").write_text("taken")  # as root, no permission would keep anybody from writing
    compiled, trouble, homographies = answered(tmp_path, **NOWHERE)
    assert compiled == len(KERNELS)
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
    first = warmed_up(package).stdout
    assert ", of which 0 were compiled" not in first
    total = first.partition(" kernels")[0]
    with read_only(package):
        done = warmed_up(package, **NOWHERE)
        assert ", of which 0 were compiled" in done.stdout
        assert not done.stderr

    home = {"HOME": str(tmp_path), "XDG_CACHE_HOME": str(tmp_path / "cache")}
    other = {**home, "NUMBA_CPU_NAME": "generic"}  # an image that was built elsewhere
    with read_only(package):
        for compiled in (total, 0):  # into the user's own folder, once
            done = warmed_up(package, **other)
            assert f", of which {compiled} were compiled" in done.stdout
            assert not done.stderr

    changed = package / "stab_ros" / "methods" / "spread.py"
    changed.write_text(changed.read_text(encoding="utf-8") + "\n", encoding="utf-8")
    with read_only(package):
        done = warmed_up(package, **NOWHERE)
        assert ", of which 1 were compiled" in done.stdout
        assert "compiled kernels cannot be kept" in done.stderr
        assert "NUMBA_CACHE_DIR" in done.stderr
