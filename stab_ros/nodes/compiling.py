"""The kernels of a node are compiled beside it: it is there, says so and can be stopped from the first moment on."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

from stab_ros.core.kernels import Compilation, compile_kernels


class Compiling:
    """Compiles on a thread, which cannot be interrupted: whoever wants to end before `done` ends the process."""

    def __init__(self) -> None:
        self.so_far = Compilation(0, 0)
        self._job = ThreadPoolExecutor(1, "compiling").submit(compile_kernels, self._tell)

    @property
    def done(self) -> bool:
        return self._job.done()

    @property
    def result(self) -> Compilation:
        """Once it is done; raises what has broken it."""
        return self._job.result()

    def _tell(self, so_far: Compilation) -> None:
        self.so_far = so_far
