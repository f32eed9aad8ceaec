"""Packages of PyPI that we are compared with: each in an environment of its own, spoken to as a child process.

Nothing of them is imported here, so neither their dependencies nor their licences touch ours.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

FOLDER = Path(__file__).resolve().parents[1] / ".venv" / "peers"
# what would lead another Python to our packages, and to the ROS 2 of our wheels
_OURS = ("LD_LIBRARY_PATH", "_ROS_WHEELS_BOOTSTRAP_COMPLETE", "PYTHONPATH", "PYTHONHOME", "VIRTUAL_ENV")
_PATIENCE_S = 900.0


class UnavailableError(Exception):
    """Why a package cannot be had, in one line."""


@dataclass(frozen=True)
class Package:
    """name: on PyPI. requirements: what pip installs with it; none: all that it asks for. home: of its environment."""

    name: str
    script: Path
    requirements: Sequence[str] = ()
    home: Path = FOLDER

    def python(self) -> Path:
        """The Python of its environment, which is made if it is not there.

        Raises:
            UnavailableError: it cannot be made.
        """
        folder = self.home.absolute() / self.name
        python, installed = folder / "bin" / "python", folder / ".installed"
        if not installed.is_file():
            _run([sys.executable, "-m", "venv", "--clear", str(folder)])
            if self.requirements:
                _run([str(python), "-m", "pip", "install", "--quiet", *self.requirements])
            only = ["--no-deps"] if self.requirements else []
            _run([str(python), "-m", "pip", "install", "--quiet", *only, self.name])
            installed.touch()
        return python


def _run(words: Sequence[str]) -> None:
    try:
        subprocess.run(words, env=_environment(), check=True, capture_output=True, text=True, timeout=_PATIENCE_S)
    except subprocess.CalledProcessError as error:
        raise UnavailableError(_reason(error.stderr or error.stdout)) from error
    except (OSError, subprocess.TimeoutExpired) as error:
        raise UnavailableError(_reason(str(error))) from error


def _environment() -> dict[str, str]:
    return {name: value for name, value in os.environ.items() if name not in _OURS}


def _reason(text: str) -> str:
    """The line that says most: the last one that is an error, or the last."""
    lines = [line.strip() for line in text.splitlines() if line.strip()] or ["it said nothing"]
    errors = [line for line in lines if "error" in line.lower()]
    return (errors or lines)[-1][:200].replace("|", "/")


@contextmanager
def running(package: Package, *arguments: str) -> Iterator[Child]:
    """The package's script, until it is no longer spoken to.

    Raises:
        UnavailableError: there is no such package, or its script ended.
    """
    words = [str(package.python()), str(package.script), *arguments]
    with (
        tempfile.TemporaryFile("w+", encoding="utf-8", errors="replace") as errors,
        subprocess.Popen(words, env=_environment(), stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=errors,
                         text=True) as process,
    ):
        yield Child(process, errors)


class Child:
    """A process that answers each line of JSON by another. What it says first is the version of its package."""

    def __init__(self, process: subprocess.Popen[str], errors: IO[str]) -> None:
        """errors: what it writes besides."""
        self._process, self._errors = process, errors
        self.version = str(self._answer())

    def ask(self, question: object) -> Any:
        assert self._process.stdin is not None
        try:
            print(json.dumps(question), file=self._process.stdin, flush=True)
        except BrokenPipeError as error:
            raise UnavailableError(self._last_words()) from error
        return self._answer()

    def _answer(self) -> Any:
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        if not line:
            raise UnavailableError(self._last_words())
        return json.loads(line)

    def _last_words(self) -> str:
        self._process.wait()
        self._errors.seek(0)
        return _reason(self._errors.read())
