"""How the inner loops are compiled: each for the types that it declares, and all of them before the first frame.

numba would compile a function when it is called, for whatever types come: seconds in the middle of a stream, and once
more for a picture whose memory happens to be read-only. A `Kernel` has one specialisation for each signature that
stands beside it, and never gets another; `compile_kernels` makes those of all modules that are imported.

The code is kept in a folder (numba's cache: `__pycache__`, else the user's, or NUMBA_CACHE_DIR). Where that cannot be
used, each process compiles for itself. The cache sees by the file of a kernel whether it is out of date, so what a
kernel calls stands in the same file.
"""

from __future__ import annotations

import pickle
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeAlias

import numba
import numpy as np
from numba import types
from numba.extending import typeof_impl

from stab_ros.core.kernel_cache import readable

Signature: TypeAlias = tuple[Any, ...]  # numba's types of the arguments; what is returned follows from them
Progress: TypeAlias = Callable[["Compilation"], None]

U8, U16, F32, F64, I64, BOOL = types.uint8, types.uint16, types.float32, types.float64, types.int64, types.boolean
_UNUSABLE = (OSError, EOFError, ValueError, pickle.PickleError)  # what numba raises of a cache


def read(dtype: Any, ndim: int) -> Any:
    """A C-contiguous array that is only read; memory that could be written will do as well."""
    return types.Array(dtype, ndim, "C", readonly=True)


def filled(dtype: Any, ndim: int) -> Any:
    """A C-contiguous array that is written into."""
    return types.Array(dtype, ndim, "C")


class Kernel:
    """A function that is compiled for its signatures, without the GIL; on its first call, if not before.

    Kernels may call each other. Arrays of another layout are copied if they are only read; other types raise TypeError.
    options: of `numba.njit`.
    """

    def __init__(self, function: Callable[..., Any], signatures: tuple[Signature, ...],
                 options: dict[str, Any]) -> None:
        self.function, self.signatures = function, signatures
        self.trouble = ""  # why its code cannot be kept, once it is compiled
        self._options = options
        self._dispatcher: Any = None

    def __call__(self, *arguments: Any) -> Any:
        dispatcher = self._dispatcher or self.dispatcher
        try:
            return dispatcher(*arguments)
        except TypeError:
            return dispatcher(*map(_laid_out, arguments, self.signatures[0]))

    @property
    def dispatcher(self) -> Any:
        """What numba made of it, with all the specialisations that it will ever have."""
        if self._dispatcher is None:
            self._dispatcher = self._compiled()
            self._dispatcher.disable_compile()
        return self._dispatcher

    @property
    def was_compiled(self) -> bool:
        """Whether any of its code was compiled by this process, and not found in the cache."""
        return any(self.dispatcher.stats.cache_misses.values())

    def _compiled(self) -> Any:
        """With the cache, where it can be used: there may be no folder, a read-only or full disk, a file cut short."""
        try:
            with readable():
                dispatcher = self._to_compile(cache=True)
        except RuntimeError as error:
            return self._without_cache(error)
        for signature in self.signatures:
            try:
                dispatcher.compile(signature)
            except _UNUSABLE as error:
                if signature not in dispatcher.overloads:
                    return self._without_cache(error)
                self.trouble = _named(error)
        return dispatcher

    def _without_cache(self, error: Exception) -> Any:
        self.trouble = _named(error)
        dispatcher = self._to_compile(cache=False)
        for signature in self.signatures:
            dispatcher.compile(signature)
        return dispatcher

    def _to_compile(self, cache: bool) -> Any:
        return numba.njit(cache=cache, nogil=True, **self._options)(self.function)


def _named(error: Exception) -> str:
    return f"{type(error).__name__}: {error}"


def _laid_out(argument: Any, declared: Any) -> Any:
    """What is only read, contiguous and aligned."""
    if isinstance(declared, types.Array) and not declared.mutable:
        return np.require(argument, requirements=["C", "A"])
    return argument


@typeof_impl.register(Kernel)
def _typeof(value: Kernel, context: Any) -> Any:
    """What a kernel that calls this one sees."""
    return typeof_impl(value.dispatcher, context)


KERNELS: list[Kernel] = []  # of all modules that are imported


def kernel(*signatures: Signature, **options: Any) -> Callable[[Callable[..., Any]], Kernel]:
    """Declares what a function is compiled for: `@kernel((read(U8, 2), F64), fastmath=True)`."""

    def declared(function: Callable[..., Any]) -> Kernel:
        KERNELS.append(Kernel(function, signatures, options))
        return KERNELS[-1]

    return declared


def inlined(**options: Any) -> Any:
    """Declares a part of the kernels of its file.

    Linked separately, what is freshly compiled and what comes from the cache would round differently with `fastmath`,
    and the live homographies would not be the command's.
    """
    return numba.njit(nogil=True, inline="always", **options)


def lazy_kernel(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Compiled when it is called, for whatever comes: for scenes that are rendered, where nobody waits for a frame."""

    def compiled(function: Callable[..., Any]) -> Any:
        try:
            return numba.njit(cache=True, nogil=True, **options)(function)
        except RuntimeError:  # there is no folder for its code
            return numba.njit(nogil=True, **options)(function)

    return compiled


@dataclass(frozen=True)
class Compilation:
    """How far `compile_kernels` has come: `done` of `total` kernels.

    compiled: those that were not found in the cache. trouble: why they cannot be kept there ("": they are).
    """

    done: int
    total: int
    compiled: int = 0
    trouble: str = ""

    def after(self, one: Kernel) -> Compilation:
        """With one kernel more."""
        return Compilation(self.done + 1, self.total, self.compiled + one.was_compiled, self.trouble or one.trouble)


def untold(_so_far: Compilation) -> None:
    """Nobody wants to know how far it is."""


def compile_kernels(progress: Progress = untold) -> Compilation:
    """Compiles all kernels of the modules that are imported, or finds them in the cache."""
    so_far = Compilation(0, len(KERNELS))
    for one in KERNELS:
        _ = one.dispatcher
        so_far = so_far.after(one)
        progress(so_far)
    return so_far
