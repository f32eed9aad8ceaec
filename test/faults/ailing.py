"""A machine that is not as it should be: small disks, little shared memory, a network that is cut. Needs root."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import pytest

needs_root = pytest.mark.skipif(os.geteuid() != 0, reason="mounting, and network namespaces, need root")


def run(*words: object) -> None:
    subprocess.run([str(word) for word in words], check=True, capture_output=True)


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


@contextmanager
def two_hosts(name: str) -> Iterator[tuple[list[str], list[str]]]:
    """Two network namespaces with a cable between them: the beginnings of commands that run on either."""
    hosts = [f"{name}a", f"{name}b"]
    try:
        for host in hosts:
            run("ip", "netns", "add", host)
        run("ip", "link", "add", f"{name}0", "netns", hosts[0], "type", "veth", "peer", f"{name}1", "netns", hosts[1])
        for number, host in enumerate(hosts):
            run("ip", "-n", host, "addr", "add", f"10.98.76.{number + 1}/24", "dev", f"{name}{number}")
            for device in ("lo", f"{name}{number}"):
                run("ip", "-n", host, "link", "set", device, "up")
            run("ip", "-n", host, "route", "add", "224.0.0.0/4", "dev", f"{name}{number}")
        yield ["ip", "netns", "exec", hosts[0]], ["ip", "netns", "exec", hosts[1]]
    finally:
        for host in hosts:
            subprocess.run(["ip", "netns", "delete", host], check=False, capture_output=True)


def plug(name: str, state: str) -> None:
    """The cable of `two_hosts`: "down" cuts it, "up" mends it."""
    run("ip", "-n", f"{name}a", "link", "set", f"{name}0", state)
    if state == "up":  # the route went with the link
        run("ip", "-n", f"{name}a", "route", "replace", "224.0.0.0/4", "dev", f"{name}0")
