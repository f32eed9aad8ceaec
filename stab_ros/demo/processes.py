"""The nodes as child processes, which end with the demo."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from stab_ros.core.errors import WorkError

PLAYER = "bag_player_node"  # ends by itself
_STEP_S = 0.1
_END_STEPS, _STOP_STEPS = 6000, 600  # waits for a node to end: normally, and after a failure until it is killed


class Node:
    """A node's process."""

    def __init__(self, name: str, process: subprocess.Popen[bytes], said: Path) -> None:
        self.name = name
        self._process = process
        self._said = said

    @property
    def ended(self) -> bool:
        return self._process.poll() is not None

    def check(self) -> None:
        """Raises WorkError if the node has ended, except for the player with exit code 0."""
        code = self._process.poll()
        if code or (code == 0 and self.name != PLAYER):
            raise WorkError(f"{self.name} {_end_in_words(code)} before the flight was over; {self._last_words()}")

    def end(self) -> None:
        """Stops the node; raises WorkError if it does not end, or with an error."""
        if self.name != PLAYER:
            self._process.send_signal(signal.SIGINT)
        if not _has_ended(self._process, _END_STEPS):
            raise WorkError(f"{self.name} was asked to end and did not; {self._last_words()}")
        if self._process.returncode:
            raise WorkError(f"{self.name} {_end_in_words(self._process.returncode)}; {self._last_words()}")

    def _last_words(self) -> str:
        lines = self._said.read_text(encoding="utf-8", errors="replace").split("\n")
        last = next((f"its last words: {line}" for line in reversed(lines) if line.strip()), "it said nothing")
        return f"{last} (see {self._said})"


def _end_in_words(code: int) -> str:
    if code >= 0:
        return f"ended with code {code}"
    names = {number.value: number.name for number in signal.Signals}
    hint = ", as by a system without memory," if code == -signal.SIGKILL else ""
    return f"was killed by {names.get(-code, f'signal {-code}')}{hint}"


def _has_ended(process: subprocess.Popen[bytes], steps: int) -> bool:
    """Waits for the end. Counts waits and not time, as this process may be stopped meanwhile."""
    for _ in range(steps):
        try:
            process.wait(_STEP_S)
        except subprocess.TimeoutExpired:
            continue
        return True
    return False


@contextmanager
def started(name: str, log: Path, parameters: Mapping[str, object], *remaps: str) -> Iterator[Node]:
    """Starts the node of this executable, in a separate session, so that Ctrl-C does not reach it."""
    words = [sys.executable, "-m", f"stab_ros.nodes.{name.removesuffix('_node')}", "--ros-args"]
    for rule in remaps:
        words += ["-r", rule]
    for key, value in parameters.items():
        words += ["-p", f"{key}:={json.dumps(value)}"]
    said = log / f"{name}.txt"
    process: subprocess.Popen[bytes] | None = None
    try:
        with said.open("wb") as output, _signals_wait():
            process = subprocess.Popen(words, stdin=subprocess.DEVNULL, stdout=output, stderr=subprocess.STDOUT,
                                       start_new_session=True)
        yield Node(name, process, said)
    finally:
        if process is not None:
            _stop(process)


@contextmanager
def _signals_wait() -> Iterator[None]:
    """Delays Ctrl-C to the end of the block; during the start of a process it would leave an unknown child."""
    caught: list[int] = []
    numbers = (signal.SIGINT, signal.SIGTERM)
    before = {number: signal.signal(number, lambda caught_now, _: caught.append(caught_now)) for number in numbers}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    if caught:
        raise KeyboardInterrupt


def _stop(process: subprocess.Popen[bytes]) -> None:
    """Ends a process that still runs after a failure."""
    process.terminate()  # no effect if it has ended
    if not _has_ended(process, _STOP_STEPS):
        process.kill()
        process.wait()
