"""SIGINT and SIGTERM, any number of them and at any time, end a node with exit code 0.

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
    """The wish to end: raises KeyboardInterrupt while the process starts, only notes it once `defer` was called."""

    def __init__(self) -> None:
        self.requested = False
        self._deferred = False
        self._importing = False

    @contextmanager
    def while_importing(self) -> Iterator[None]:
        """A signal ends the process at once: raised in the middle of an import it may come out as another error."""
        self._importing = True
        yield
        self._importing = False

    def defer(self) -> None:
        """From now on work is not interrupted; whoever works looks at `requested`."""
        self._deferred = True

    def on_signal(self, _number: int, _frame: FrameType | None) -> None:
        if self._importing:
            os._exit(0)  # no DDS yet, so nothing of it is left behind
        first, self.requested = not self.requested, True
        if first and not self._deferred:
            raise KeyboardInterrupt


def end_at_once() -> NoReturn:
    """Ends the process under a thread that compiles: waiting for it takes seconds, and LLVM is not to be torn down."""
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(0)


def until_stopped(body: Callable[[StopRequest], int]) -> int:
    """The exit code of `body`; 0 if a signal ended it during its start."""
    stop = StopRequest()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, stop.on_signal)
    try:
        return body(stop)
    except KeyboardInterrupt:
        return 0
    finally:  # what remains is the end of the process, which a further signal must not turn into a failure
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, signal.SIG_IGN)


def node_main(name: str, body: Callable[[StopRequest], int]) -> int:
    """`until_stopped` for an executable: an error of ours is one line on stderr and exit code 2 (input) or 1 (work)."""
    try:
        return until_stopped(body)
    except StabRosError as error:
        print(f"{name}: {one_line(error)}", file=sys.stderr)
        return 2 if isinstance(error, InputError) else 1
