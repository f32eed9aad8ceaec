"""Feeds damaged bytes to every reader: `python test/faults/fuzz.py --inputs 10000`; exit code 1 where one has a bug.

Each target runs in a child process of its own, which must survive, stay below a cap of memory and take no longer than
some seconds for any input. An input depends on its number and `--seed` alone: what failed is repeated as printed.
"""

from __future__ import annotations

import argparse
import faulthandler
import json
import os
import random
import resource
import subprocess
import sys
import time
import traceback
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, field
from mmap import mmap
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from fuzz_targets import Target

FOLDER = Path(__file__).parent
MEMORY_MB = 300
INPUT_S = 10.0
START_S = 60.0  # for the child's imports
FAILURES = 5  # of a target, then it is given up
_SHARED_MEMORY = Path("/dev/shm")
_POLL_S = 0.1


@dataclass
class Result:
    """What came of the inputs of one target."""

    target: str
    inputs: int = 0
    refused: int = 0
    accepted: int = 0
    seconds: float = 0.0
    slowest_ms: float = 0.0
    slowest: int = -1
    peak_mb: float = 0.0
    failures: list[str] = field(default_factory=list)

    @property
    def row(self) -> tuple[str, ...]:
        rate = self.inputs / self.seconds if self.seconds else 0.0
        return (self.target, f"{self.inputs}", f"{self.refused}", f"{self.accepted}", f"{rate:.0f}",
                f"{self.peak_mb:.0f}", f"{self.slowest_ms:.0f}")


def peak_mb() -> float:
    """Of this process since it began."""
    status = Path("/proc/self/status").read_text(encoding="ascii")
    return int(status.split("VmHWM:")[1].split()[0]) * 1024 / 1e6


# the child ------------------------------------------------------------------------------------------------------------
class Run:
    """The inputs first, first + 1, ... of one target."""

    def __init__(self, name: str, target: Target, seeds: Sequence[bytes], seed: int) -> None:
        self.result = Result(name)
        self._target, self._seeds = target, seeds
        self._base = random.Random(zlib.crc32(name.encode()) + 2**32 * seed).getrandbits(60)

    def input(self, number: int) -> bytes:
        from mutate import mutated

        return mutated(self._seeds, self._base + number, self._target.tokens)

    def one(self, number: int) -> None:
        """Reads one input and notes what came of it."""
        from stab_ros.core.errors import StabRosError

        data, result = self.input(number), self.result
        began_s = time.perf_counter()
        try:
            self._target.read(data)
            result.accepted += 1
        except StabRosError as error:
            result.refused += 1
            if len(str(error).splitlines()) != 1:
                self._fail(number, f"an error of several lines: {error!r}")
        except Exception:  # noqa: BLE001
            self._fail(number, traceback.format_exc())
        ms = (time.perf_counter() - began_s) * 1e3
        result.inputs += 1
        result.seconds += ms / 1e3
        if ms > result.slowest_ms:
            result.slowest_ms, result.slowest = ms, number
        if resource.getrusage(resource.RUSAGE_SELF).ru_maxrss > MEMORY_MB * 1e6 / 1024 and peak_mb() > MEMORY_MB:
            self._fail(number, f"takes {peak_mb():.0f} MB, {MEMORY_MB} are allowed")
            raise MemoryError

    def _fail(self, number: int, why: str) -> None:
        self.result.failures.append(f"input {number}: {why.strip()}")


def child(name: str, seed: int, first: int, count: int, seeds: Path, place: Path) -> None:
    """Runs the inputs; `place` is shared with the parent, who sees there which one it is."""
    faulthandler.enable()
    from fuzz_seeds import read_seeds
    from fuzz_targets import TARGETS

    run = Run(name, TARGETS[name], read_seeds(seeds), seed)
    with place.open("r+b") as file, mmap(file.fileno(), 8) as shared:
        try:
            for number in range(first, first + count):
                shared[:] = number.to_bytes(8, "little")
                run.one(number)
                if len(run.result.failures) >= FAILURES:
                    break
        except MemoryError:
            pass
        run.result.peak_mb = peak_mb()
        print(json.dumps(asdict(run.result)))


# the parent -----------------------------------------------------------------------------------------------------------
def run_child(name: str, seed: int, first: int, count: int, seeds: Path) -> Result:
    """One target in a process of its own, which may crash or hang."""
    with TemporaryDirectory(dir=_SHARED_MEMORY if _SHARED_MEMORY.is_dir() else None) as folder:
        place = Path(folder) / "place"
        place.write_bytes((2**64 - 1).to_bytes(8, "little"))
        said = {stream: place.with_name(stream) for stream in ("out", "err")}
        with said["out"].open("w+b") as out, said["err"].open("w+b") as err:
            command = [sys.executable, str(FOLDER / "fuzz.py"), "--child", name, "--seed", str(seed),
                       "--first", str(first), "--inputs", str(count), "--seeds", str(seeds), "--place", str(place)]
            process = subprocess.Popen(command, stdout=out, stderr=err, cwd=folder,
                                       env={**os.environ, "OPENCV_LOG_LEVEL": "SILENT"})
            hung = not _watched(process, place, name, count, first)
        last = int.from_bytes(place.read_bytes(), "little")
        if hung or process.returncode:
            what = f"takes more than {INPUT_S:g} s" if hung else f"ends the process with {process.returncode}"
            errors = said["err"].read_text(encoding="utf-8", errors="replace")[-2000:]
            return Result(name, failures=[f"input {last}: {what}\n{errors}"])
        return Result(**json.loads(said["out"].read_text(encoding="utf-8")))


def _watched(process: subprocess.Popen[bytes], place: Path, name: str, count: int, first: int) -> bool:
    """Waits for the end; False where one input took too long, and the process was killed."""
    from tqdm import tqdm

    last, since_s = -1, time.monotonic()
    with tqdm(total=count, desc=name, unit=" inputs", leave=False, disable=not sys.stderr.isatty()) as bar:
        while process.poll() is None:
            time.sleep(_POLL_S)
            number = int.from_bytes(place.read_bytes(), "little")
            if number != last:
                last, since_s = number, time.monotonic()
                bar.update(max(0, min(number - first, count) - bar.n))
            elif time.monotonic() - since_s > (INPUT_S if last < 2**64 - 1 else START_S):
                process.kill()
                process.wait()
                return False
    return True


def shares(inputs: int, targets: dict[str, Target]) -> Iterator[tuple[str, int]]:
    """How many inputs each target gets; at least one."""
    whole = sum(target.share for target in targets.values())
    for name, target in targets.items():
        yield name, max(1, round(inputs * target.share / whole))


def fuzz(options: argparse.Namespace) -> list[Result]:
    """All targets, one after the other."""
    from fuzz_targets import TARGETS

    chosen = {name: TARGETS[name] for name in options.target or TARGETS}
    results = []
    with TemporaryDirectory() as folder:
        subprocess.run([sys.executable, FOLDER / "fuzz_seeds.py", folder], check=True)
        for name, count in shares(options.inputs, chosen):
            results.append(run_child(name, options.seed, options.first, count, Path(folder) / f"{name}.seeds"))
            print("{:14}{:>9}{:>9}{:>9}{:>10}{:>8}{:>11}".format(*results[-1].row), flush=True)
            for failure in results[-1].failures:
                print(f"  {failure}\n  again: fuzz.py --target {name} --seed {options.seed} --first "
                      f"{failure.split()[1].rstrip(':')} --inputs 1", flush=True)
    return results


def parsed() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--inputs", type=int, default=10_000, help="of all targets together")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--target", action="append", help="this one alone; may be given several times")
    parser.add_argument("--first", type=int, default=0, help="number of the first input")
    for name in ("child", "seeds", "place"):
        parser.add_argument(f"--{name}", help=argparse.SUPPRESS)
    return parser.parse_args()


def main() -> int:
    options = parsed()
    if options.child:
        child(options.child, options.seed, options.first, options.inputs, Path(options.seeds), Path(options.place))
        return 0
    print("{:14}{:>9}{:>9}{:>9}{:>10}{:>8}{:>11}".format(
        "target", "inputs", "refused", "accepted", "inputs/s", "peak MB", "slowest ms"))
    results = fuzz(options)
    failures = sum(len(result.failures) for result in results)
    print(f"{sum(result.inputs for result in results)} inputs, {failures} failures")
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
