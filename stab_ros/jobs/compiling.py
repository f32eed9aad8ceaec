"""What a person sees of the kernels being compiled: once after an installation, and never again if they can be kept."""

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

_REMEDY = "let a user who may write there run `stab-ros warm-up`, or name a folder in NUMBA_CACHE_DIR"


def not_kept(trouble: str) -> str:
    """What to say where the compiled kernels cannot be kept."""
    return one_line(f"compiled kernels cannot be kept, so each start takes longer ({trouble}); {_REMEDY}")


def compile_shown() -> Compilation:
    """Compiles all kernels of imported modules: a bar on a terminal, a line if it must be done anew each time.

    Ctrl-C takes effect between two kernels: raised within the compiler it may come out as another error, or not at all.
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
    if interrupted:  # while the last one was compiled
        raise KeyboardInterrupt
    if done.trouble:
        print(f"stab-ros: warning: {not_kept(done.trouble)}", file=sys.stderr)
    return done


@contextmanager
def _interrupts_noted() -> Iterator[list[int]]:
    """Holds the number of each SIGINT that comes within it; only a main thread can be told of them."""
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
    import_module("stab_ros.parameters.engines")  # imports every module that has kernels
    return compile_shown()


def warm_up() -> str:
    """Compiles all kernels; returns a line that says how many and how long it took."""
    started_s = time.monotonic()
    done = compile_all()
    return f"{done.total} kernels, of which {done.compiled} were compiled now, {time.monotonic() - started_s:.1f} s"
