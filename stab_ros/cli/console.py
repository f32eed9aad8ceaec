"""What a command prints, and its exit code."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, redirect_stderr
from pathlib import Path

from stab_ros.core.errors import WorkError
from stab_ros.core.progress import Progress
from stab_ros.core.text import one_line

DONE, BROKEN_OFF, BAD_INPUT, INTERRUPTED = 0, 1, 2, 130  # exit codes
_STDERR = 2


def say(line: str) -> None:
    """Prints one line on stderr, after the program's name."""
    print("stab-ros:", one_line(line), file=sys.stderr)


def tell(*lines: str) -> None:
    """Prints lines on standard output, at once.

    Raises:
        WorkError: they cannot be written. BrokenPipeError: their reader is gone.
    """
    if sys.stdout is None:  # as with >&-
        return
    try:
        for line in lines:
            print(line)
        sys.stdout.flush()
    except BrokenPipeError:
        raise
    except OSError as error:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # so that the rest does not fail again
        raise WorkError(f"standard output cannot be written ({error.strerror}); it must lead to a terminal, a pipe or "
                        "a file") from error


def tell_made(made: Mapping[str, Path]) -> None:
    """Prints the path of every output, after its kind."""
    for name, path in made.items():
        tell(f"{name + ':':8} {path}")


def warn(warnings: Iterable[str]) -> None:
    """Prints warnings on stderr, one line each."""
    for warning in warnings:
        say(f"warning: {warning}")


def note(notes: Iterable[str]) -> None:
    """Prints what is no reason to worry on stderr, one line each."""
    for one in notes:
        say(f"note: {one}")


@contextmanager
def progress_bar(unit: str) -> Iterator[Progress]:
    """A progress bar with rate and remaining time; it appears with the first item, on a terminal only."""
    from stab_ros.jobs.progress_bar import make_bar

    with ExitStack() as bars:
        bar = None

        def show(done: int, total: int | None) -> None:
            nonlocal bar
            if bar is None:  # without a total it has no truth value
                bar = bars.enter_context(make_bar(unit, total=total))
            bar.total = total
            bar.update(done - bar.n)

        yield show


@contextmanager
def quiet_libraries() -> Iterator[None]:
    """Silences libjpeg, libpng and FFmpeg, which write to descriptor 2 directly; `sys.stderr` still works."""
    with os.fdopen(os.dup(_STDERR), "w", buffering=1, errors="backslashreplace") as ours, redirect_stderr(ours):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, _STDERR)
        os.close(nowhere)
        try:
            yield
        finally:
            os.dup2(ours.fileno(), _STDERR)
