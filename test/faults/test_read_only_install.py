"""A package that nobody can write beside, and a user without a home, as a service has in a container."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ailing import needs_root, run

import stab_ros

NOWHERE = {"HOME": "/proc/1/nowhere", "XDG_CACHE_HOME": "/proc/1/nowhere"}


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
    shutil.copytree(Path(stab_ros.__file__).parent, package / "stab_ros", ignore=shutil.ignore_patterns("__pycache__"))
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
