"""Compiles the kernels of a node on a thread, so that the node reports and can be stopped from the start."""

from __future__ import annotations

import time
from concurrent.futures import ThreadPoolExecutor

from rclpy.impl.rcutils_logger import RcutilsLogger

from stab_ros.core.kernels import Compilation, compile_kernels
from stab_ros.jobs.compiling import not_kept


class BackgroundCompilation:
    """Starts at once. The thread cannot be interrupted: to end before `done`, end the process."""

    def __init__(self) -> None:
        self.progress, self._started_s = Compilation(0, 0), time.monotonic()
        self._job = ThreadPoolExecutor(1, "compilation").submit(compile_kernels, self._update)

    @property
    def done(self) -> bool:
        return self._job.done()

    @property
    def result(self) -> Compilation:
        """Waits for the result; raises the exception that ended the compilation, if any."""
        return self._job.result()

    @property
    def age_s(self) -> float:
        """Time since it began, s."""
        return time.monotonic() - self._started_s

    def tell(self, log: RcutilsLogger) -> None:
        """Logs the result, unless all kernels were found in the cache."""
        if self.result.compiled:
            log.info(f"compiled {self.result.compiled} of {self.result.total} kernels in {self.age_s:.1f} s")
        if self.result.trouble:
            log.warning(not_kept(self.result.trouble))

    def _update(self, progress: Compilation) -> None:
        self.progress = progress
