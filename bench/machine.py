"""Where the figures come from: processor, cores, versions."""

from __future__ import annotations

import datetime
import os
import platform
from importlib.metadata import version
from pathlib import Path

import cv2
import numba

CORES = 2


def use_two_cores() -> None:
    """The targets are for two cores: on a larger machine the others are left out."""
    cores = sorted(os.sched_getaffinity(0))[:CORES]
    os.sched_setaffinity(0, cores)
    cv2.setNumThreads(len(cores))
    numba.set_num_threads(min(len(cores), numba.config.NUMBA_NUM_THREADS))


def describe() -> dict[str, object]:
    """For the head of the report."""
    return {
        "date": datetime.datetime.now(tz=datetime.timezone.utc).isoformat(timespec="seconds"),
        "cpu": _processor(),
        "cores": {"machine": os.cpu_count(), "used": len(os.sched_getaffinity(0))},
        "memory_gb": round(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30, 1),
        "load_average": [round(load, 2) for load in os.getloadavg()],
        "python": platform.python_version(),
        "numpy": version("numpy"),
        "numba": version("numba"),
        "opencv": cv2.__version__,
        "stab_ros": version("stab_ros"),
    }


def _processor() -> str:
    """Model and clock as the kernel tells them."""
    lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    told = [line.split(":", 1) for line in lines if ":" in line]
    facts = {name.strip(): value.strip() for name, value in reversed(told)}
    name = facts.get("model name", platform.machine())
    return f"{name}, {facts['cpu MHz']} MHz" if "cpu MHz" in facts else name
