"""Compilation of the inner loops: each kernel for its declared types, and all kernels before the first frame.

By default numba compiles a function at its first call for the argument types of that call. This takes seconds in the
middle of a stream, and again for an image in read-only memory. A `Kernel` has one specialization per declared signature
and is never compiled for others. `compile_kernels` compiles the kernels of all imported modules.

Compiled code is cached in a folder (numba's cache: `__pycache__`, else the user's cache, or NUMBA_CACHE_DIR). Where no
cache is usable, each process compiles again. The cache detects changes by the source file of a kernel, so functions
called by a kernel must be in the same file.
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

Signature: TypeAlias = tuple[Any, ...]  # numba types of the arguments; the return type is inferred
CompilationProgress: TypeAlias = Callable[["Compilation"], None]
Compiler: TypeAlias = Callable[[], "Compilation"]

U8, U16, I16, I32, I64, BOOL = types.uint8, types.uint16, types.int16, types.int32, types.int64, types.boolean
F32, F64 = types.float32, types.float64


def read(dtype: Any, ndim: int) -> Any:
    """Type of a C-contiguous input array; read-only and writable arrays are accepted."""
    return types.Array(dtype, ndim, "C", readonly=True)


def filled(dtype: Any, ndim: int) -> Any:
    """Type of a C-contiguous output array."""
    return types.Array(dtype, ndim, "C")


class Kernel:
    """A function compiled for its declared signatures, at its first call or earlier; it releases the GIL.

    Kernels may call each other. Input arrays that are not C-contiguous are copied.

    Attributes:
        function: the Python function.
        signatures: the declared signatures.
        trouble: why the compiled code cannot be cached; empty if it can.

    Raises:
        TypeError: a call with arguments of other types.
    """

    def __init__(self, function: Callable[..., Any], signatures: tuple[Signature, ...],
                 options: dict[str, Any]) -> None:
        """function: to compile. signatures: for which. options: of `numba.njit`."""
        self.function, self.signatures = function, signatures
        self.trouble = ""
        self._options = options
        self._dispatcher: Any = None

    def __call__(self, *arguments: Any) -> Any:
        dispatcher = self._dispatcher or self.dispatcher
        try:
            return dispatcher(*arguments)
        except TypeError:
            if len(arguments) != len(self.signatures[0]):
                raise
            return dispatcher(*map(_with_declared_layout, arguments, self.signatures[0]))

    @property
    def dispatcher(self) -> Any:
        """Numba's dispatcher with all specializations."""
        with _COMPILE_LOCK:
            if self._dispatcher is None:
                self._dispatcher = self.function if numba.config.DISABLE_JIT else self._compiled()
        return self._dispatcher

    @property
    def was_compiled(self) -> bool:
        """Whether this process compiled it instead of loading it from the cache."""
        return not numba.config.DISABLE_JIT and any(self.dispatcher.stats.cache_misses.values())

    def _compiled(self) -> Any:
        """Compiled with numba's cache if that is usable; damaged entries are deleted and compiled again."""
        try:
            with readable():
                dispatcher = self._to_compile(cache=True)
        except RuntimeError as error:  # there is no folder for the cache
            return self._uncached(error)
        try:
            return self._specialized(dispatcher)
        except UNUSABLE as error:
            return self._recompiled(dispatcher, error)

    def _recompiled(self, damaged: Any, error: Exception) -> Any:
        """Compiled again after a damaged cache entry was deleted; without the cache if that fails, too."""
        try:
            forget(damaged)
            return self._specialized(self._to_compile(cache=True))
        except UNUSABLE:
            return self._uncached(error)

    def _uncached(self, error: Exception) -> Any:
        self.trouble = _named(error)
        return self._specialized(self._to_compile(cache=False))

    def _specialized(self, dispatcher: Any) -> Any:
        for signature in self.signatures:
            try:
                dispatcher.compile(signature)
            except OSError as error:  # for example a full disk: it is compiled but not cached
                if signature not in dispatcher.overloads:
                    raise
                self.trouble = _named(error)
        dispatcher.disable_compile()
        return dispatcher

    def _to_compile(self, cache: bool) -> Any:
        return numba.njit(cache=cache, nogil=True, **self._options)(self.function)


_COMPILE_LOCK = RLock()  # reentrant, because one kernel may call another


def _named(error: Exception) -> str:
    return f"{type(error).__name__}: {error}"


def _with_declared_layout(argument: Any, declared: Any) -> Any:
    """Input arrays made contiguous and aligned; other arguments unchanged."""
    if isinstance(declared, types.Array) and not declared.mutable:
        return np.require(argument, requirements=["C", "A"])
    return argument


@typeof_impl.register(Kernel)
def _typeof(value: Kernel, context: Any) -> Any:
    """The numba type of a kernel inside another kernel."""
    return typeof_impl(value.dispatcher, context)


KERNELS: list[Kernel] = []  # of all imported modules


def kernel(*signatures: Signature, **options: Any) -> Callable[[Callable[..., Any]], Kernel]:
    """Decorator that declares a kernel: `@kernel((read(U8, 2), F64), fastmath=True)`.

    signatures: argument types. options: of `numba.njit`.
    """

    def declared(function: Callable[..., Any]) -> Kernel:
        KERNELS.append(Kernel(function, signatures, options))
        return KERNELS[-1]

    return declared


def inlined(**options: Any) -> Any:
    """Decorator of a function that is inlined into the kernels of its file. options: of `numba.njit`.

    If it were linked separately, freshly compiled and cached code would round differently with `fastmath`, and the node
    and the command line would give different homographies.
    """
    return numba.njit(nogil=True, inline="always", **options)


def lazy_kernel(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Decorator of a function that numba compiles at its first call, for code without real-time demands (rendering).

    options: of `numba.njit`.
    """

    def compiled(function: Callable[..., Any]) -> Any:
        try:
            return numba.njit(cache=True, nogil=True, **options)(function)
        except RuntimeError:  # there is no folder for the cache
            return numba.njit(nogil=True, **options)(function)

    return compiled


@dataclass(frozen=True)
class Compilation:
    """Progress of `compile_kernels`.

    Attributes:
        done: number of finished kernels.
        total: number of kernels.
        compiled: number of kernels that were not in the cache.
        trouble: why they cannot be cached; empty if they can.
    """

    done: int
    total: int
    compiled: int = 0
    trouble: str = ""

    @property
    def awaited(self) -> str:
        """What a node waits for meanwhile."""
        if not self.total:
            return "kernels to be loaded"
        return f"kernels to be compiled, {self.done} of {self.total} are done"

    def after(self, one: Kernel) -> Compilation:
        """The progress after one more kernel."""
        return Compilation(self.done + 1, self.total, self.compiled + one.was_compiled, self.trouble or one.trouble)


def no_progress(_so_far: Compilation) -> None:
    """Default progress callback, which does nothing."""


def compile_kernels(progress: CompilationProgress = no_progress) -> Compilation:
    """Compiles the kernels of all imported modules, or loads them from the cache.

    progress: called after each kernel.
    """
    so_far = Compilation(0, len(KERNELS))
    for one in KERNELS:
        _ = one.dispatcher
        so_far = so_far.after(one)
        progress(so_far)
    return so_far
