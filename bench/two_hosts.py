"""Two network namespaces of this machine that stand for two hosts, and the cable between them. Needs root."""

from __future__ import annotations

import subprocess
from collections.abc import Iterator
from contextlib import contextmanager


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


def narrow(name: str, mbit_s: float, queue_bytes: int) -> None:
    """Limits what the first of the hosts sends; what finds no room in the queue before the cable is lost."""
    run("tc", "-n", f"{name}a", "qdisc", "replace", "dev", f"{name}0", "root", "tbf", "rate", f"{mbit_s:g}mbit",
        "burst", "32kb", "limit", queue_bytes)


def run(*words: object) -> None:
    """A command that must succeed."""
    subprocess.run([str(word) for word in words], check=True, capture_output=True)
