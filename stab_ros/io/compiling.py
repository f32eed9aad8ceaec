"""What a person sees of the kernels being compiled: once after an installation, and never again if they can be kept."""

from __future__ import annotations

import sys
import time
from importlib import import_module

from tqdm import tqdm

from stab_ros.core.kernels import Compilation, compile_kernels
from stab_ros.io.bars import make_bar
from stab_ros.io.text import one_line

_REMEDY = "let a user who may write there run `stab-ros warm-up`, or name a folder in NUMBA_CACHE_DIR"


def not_kept(trouble: str) -> str:
    """What to say where the compiled kernels cannot be kept."""
    return one_line(f"compiled kernels cannot be kept, so each start takes longer ({trouble}); {_REMEDY}")


class Shown:
    """A bar on a terminal, if there is anything to compile; a line if it must be done anew each time."""

    def __init__(self) -> None:
        self._bar: tqdm[None] | None = None

    def __call__(self, so_far: Compilation) -> None:
        if so_far.compiled:
            self._bar = self._bar or make_bar("kernels", total=so_far.total, desc="compiling, once")
            self._bar.update(so_far.done - self._bar.n)
        if so_far.done == so_far.total:
            self._end(so_far.trouble)

    def _end(self, trouble: str) -> None:
        if self._bar is not None:
            self._bar.close()
        if trouble:
            print(f"stab-ros: warning: {not_kept(trouble)}", file=sys.stderr)


def warm_up() -> str:
    """Compiles all that nodes and commands need; what came of it, in a line."""
    started_s = time.monotonic()
    import_module("stab_ros.io.engine")  # which needs all of them
    done = compile_kernels(Shown())
    return f"{done.total} kernels, of which {done.compiled} were compiled now, {time.monotonic() - started_s:.1f} s"
