"""A machine that is not as it should be: small disks, little shared memory, links that are cut or slow. Needs root."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import pytest
from two_hosts import run

_ROOT = Path(__file__).parents[2]
HELPERS = f"{_ROOT / 'test' / 'helpers'}:{_ROOT / 'bench'}"  # PYTHONPATH of a test that runs again as a program
_TOOLS = ("ip", "tc")  # of iproute2

needs_root = pytest.mark.skipif(os.geteuid() != 0, reason="mounting, and network namespaces, need root")
needs_links = pytest.mark.skipif(os.geteuid() != 0 or None in map(shutil.which, _TOOLS),
                                 reason="network namespaces need root, ip and tc")


@contextmanager
def small_disk(folder: Path, size_kb: int) -> Iterator[Path]:
    """A file system of so many kB at the new `folder`."""
    folder.mkdir()
    run("mount", "-t", "tmpfs", "-o", f"size={size_kb}k", "tmpfs", folder)
    try:
        yield folder
    finally:
        run("umount", "--lazy", folder)  # a node under test may still have a file open


def with_shared_memory(size_mb: int, words: Sequence[str]) -> list[str]:
    """`words` as a command that sees a /dev/shm of its own of that size."""
    return ["unshare", "--mount", "sh", "-c", f'mount -t tmpfs -o size={size_mb}m tmpfs /dev/shm && exec "$@"', "sh",
            *words]
