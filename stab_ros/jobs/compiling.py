"""Compilation of the kernels with a progress bar: once after an installation, as long as the result can be cached."""

from __future__ import annotations

import signal
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from threading import current_thread, main_thread

from tqdm import tqdm

from stab_ros.core.kernels import Compilation, compile_kernels
from stab_ros.core.text import one_line
from stab_ros.jobs.progress_bar import make_bar

_ENGINES = ("stab_ros.parameters.engines", "stab_ros.parameters.velocimeters")  # they import what has kernels
_REMEDY = "let a user who may write there run `stab-ros warm-up`, or name a folder in NUMBA_CACHE_DIR"


def not_kept(trouble: str) -> str:
    """The warning that compiled kernels cannot be cached."""
    return one_line(f"compiled kernels cannot be kept, so each start takes longer ({trouble}); {_REMEDY}")


def compile_shown() -> Compilation:
    """Compiles all kernels of imported modules; shows a progress bar on a terminal, and warns if they cannot be cached.

    Ctrl-C takes effect between two kernels: the compiler may turn an exception into another one, or lose it.
    """
    bar: tqdm[None] | None = None
    with _interrupts_noted() as interrupted:

        def show(so_far: Compilation) -> None:
            nonlocal bar
            if interrupted:
                raise KeyboardInterrupt
            if so_far.compiled:
                bar = bar or make_bar("kernels", total=so_far.total, desc="compiling, once")
                bar.update(so_far.done - bar.n)

        try:
            done = compile_kernels(show)
        finally:
            if bar is not None:
                bar.close()
    if interrupted:  # during the last kernel
        raise KeyboardInterrupt
    if done.trouble:
        print(f"stab-ros: warning: {not_kept(done.trouble)}", file=sys.stderr)
    return done


@contextmanager
def _interrupts_noted() -> Iterator[list[int]]:
    """Collects the SIGINTs that arrive in the block; only the main thread receives any."""
    noted: list[int] = []
    if current_thread() is not main_thread():
        yield noted
        return
    before = signal.signal(signal.SIGINT, lambda number, _: noted.append(number))
    try:
        yield noted
    finally:
        signal.signal(signal.SIGINT, before)


def compile_all() -> Compilation:
    """Compiles the kernels of all engines, for `warm-up` and before several processes start that need them."""
    for engines in _ENGINES:
        import_module(engines)
    return compile_shown()


def warm_up() -> str:
    """Compiles all kernels; returns a line that says how many and how long it took."""
    started_s = time.monotonic()
    done = compile_all()
    return f"{done.total} kernels, of which {done.compiled} were compiled now, {time.monotonic() - started_s:.1f} s"
