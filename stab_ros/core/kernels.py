"""How the inner loops are compiled: each for the types that it declares, and all of them before the first frame.

numba would compile a function when it is called, for whatever types come: seconds in the middle of a stream, and once
more for a picture whose memory happens to be read-only. A `Kernel` has one specialisation for each signature that
stands beside it, and never gets another; `compile_kernels` makes those of all modules that are imported.

The code is kept in a folder (numba's cache: `__pycache__`, else the user's, or NUMBA_CACHE_DIR). Where that cannot be
used, each process compiles for itself. The cache sees by the file of a kernel whether it is out of date, so what a
kernel calls stands in the same file.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from threading import RLock
from typing import Any, TypeAlias

import numba
import numpy as np
from numba import types
from numba.extending import typeof_impl

from stab_ros.core.kernel_cache import UNUSABLE, forget, readable

Signature: TypeAlias = tuple[Any, ...]  # numba's types of the arguments; what is returned follows from them
Progress: TypeAlias = Callable[["Compilation"], None]
Compiler: TypeAlias = Callable[[], "Compilation"]

U8, U16, F32, F64, I64, BOOL = types.uint8, types.uint16, types.float32, types.float64, types.int64, types.boolean


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
            if len(arguments) != len(self.signatures[0]):
                raise
            return dispatcher(*map(_laid_out, arguments, self.signatures[0]))

    @property
    def dispatcher(self) -> Any:
        """What numba made of it, with all the specialisations that it will ever have."""
        with _ONE_AT_A_TIME:
            if self._dispatcher is None:
                self._dispatcher = self.function if numba.config.DISABLE_JIT else self._compiled()
        return self._dispatcher

    @property
    def was_compiled(self) -> bool:
        """Whether any of its code was compiled by this process, and not found in the cache."""
        return not numba.config.DISABLE_JIT and any(self.dispatcher.stats.cache_misses.values())

    def _compiled(self) -> Any:
        """With the cache, where there is one that can be used; what is damaged in it is made anew."""
        try:
            with readable():
                dispatcher = self._to_compile(cache=True)
        except RuntimeError as error:  # there is no folder for it
            self.trouble = _named(error)
            return self._specialised(self._to_compile(cache=False))
        try:
            return self._specialised(dispatcher)
        except UNUSABLE as error:
            return self._anew(dispatcher, error)

    def _anew(self, damaged: Any, error: Exception) -> Any:
        try:
            forget(damaged)
            return self._specialised(self._to_compile(cache=True))
        except UNUSABLE:
            self.trouble = _named(error)
            return self._specialised(self._to_compile(cache=False))

    def _specialised(self, dispatcher: Any) -> Any:
        for signature in self.signatures:
            try:
                dispatcher.compile(signature)
            except OSError as error:  # a full disk: it is compiled, but could not be kept
                if signature not in dispatcher.overloads:
                    raise
                self.trouble = _named(error)
        dispatcher.disable_compile()
        return dispatcher

    def _to_compile(self, cache: bool) -> Any:
        return numba.njit(cache=cache, nogil=True, **self._options)(self.function)


_ONE_AT_A_TIME = RLock()  # kernels that are compiled: one may need another


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
