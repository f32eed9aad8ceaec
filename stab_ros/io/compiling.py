"""What a person sees of the kernels being compiled: once after an installation, and never again if they can be kept."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module

from tqdm import tqdm

from stab_ros.core.kernels import Compilation, Progress, compile_kernels
from stab_ros.io.text import one_line

_REMEDY = "let a user who may write there run `stab-ros warm-up`, or name a folder in NUMBA_CACHE_DIR"


def not_kept(trouble: str) -> str:
    """What to say where the compiled kernels cannot be kept."""
    return one_line(f"compiled kernels cannot be kept, so each start takes longer ({trouble}); {_REMEDY}")


@contextmanager
def shown() -> Iterator[Progress]:
    """A bar, on a terminal and if there is anything to compile; a line if it must be done anew each time."""
    with tqdm(unit=" kernels", desc="compiling, once", disable=None, leave=False, delay=1e-9) as bar:

        def show(so_far: Compilation) -> None:
            if so_far.compiled:
                bar.total = so_far.total
                bar.update(so_far.done - bar.n)
            if so_far.trouble and so_far.done == so_far.total:
                tqdm.write(f"stab-ros: warning: {not_kept(so_far.trouble)}", sys.stderr)

        yield show


def warm_up() -> str:
    """Compiles all that nodes and commands need; what came of it, in a line."""
    started_s = time.monotonic()
    import_module("stab_ros.io.engine")  # which needs all of them
    with shown() as progress:
        done = compile_kernels(progress)
    return f"{done.total} kernels, of which {done.compiled} were compiled now, {time.monotonic() - started_s:.1f} s"
