"""SIGINT, SIGTERM and SIGHUP, at any time and repeatedly, end a node with exit code 0.

rclpy's own handlers shut the context down at once, with messages still queued; so a node installs these instead, and
before the heavy imports, so that a Ctrl-C during start is a clean end too.
"""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import NoReturn

from stab_ros.core.errors import InputError, StabRosError
from stab_ros.core.text import one_line


class StopRequest:
    """A request to end: raises KeyboardInterrupt while the process starts; sets `requested` only after `defer`."""

    def __init__(self) -> None:
        self.requested = False
        self._deferred = False
        self._importing = False

    @contextmanager
    def while_importing(self) -> Iterator[None]:
        """A signal ends the process at once: an exception in the middle of an import may surface as another error."""
        self._importing = True
        yield
        self._importing = False

    def defer(self) -> None:
        """From now on signals do not raise; the work checks `requested`."""
        self._deferred = True

    def on_signal(self, _number: int, _frame: FrameType | None) -> None:
        if self._importing:
            os._exit(0)  # no DDS yet, so nothing of it is left behind
        first, self.requested = not self.requested, True
        if first and not self._deferred:
            raise KeyboardInterrupt


def end_at_once() -> NoReturn:
    """Ends the process while a thread compiles: waiting takes seconds, and LLVM must not be torn down under it."""
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(0)


def until_stopped(body: Callable[[StopRequest], int]) -> int:
    """The exit code of `body`; 0 if a signal ended it during its start."""
    stop = StopRequest()
    for number in _stopping():
        signal.signal(number, stop.on_signal)
    try:
        return body(stop)
    except KeyboardInterrupt:
        return 0
    finally:  # a further signal must not turn the end of the process into a failure
        for number in _stopping():
            signal.signal(number, signal.SIG_IGN)


def _stopping() -> list[signal.Signals]:
    """The signals that end a process; a lost terminal does not if it was started with nohup."""
    kept = signal.getsignal(signal.SIGHUP) == signal.SIG_IGN
    return [signal.SIGINT, signal.SIGTERM, *([] if kept else [signal.SIGHUP])]


def node_main(name: str, body: Callable[[StopRequest], int]) -> int:
    """`until_stopped` for an executable: a StabRosError is one line on stderr and exit code 2 (input) or 1 (work)."""
    try:
        return until_stopped(body)
    except StabRosError as error:
        print(f"{name}: {one_line(error)}", file=sys.stderr)
        return 2 if isinstance(error, InputError) else 1
