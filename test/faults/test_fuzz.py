"""Damaged bytes in every reader: no crash, no other error, no hang, and no memory beyond the cap."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

FUZZ = Path(__file__).with_name("fuzz.py")
INPUTS, SEED = 10_000, 2026


def run(*options: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, str(FUZZ), *map(str, options)], capture_output=True, text=True, check=False,
                          timeout=900)


def test_ten_thousand_damaged_inputs() -> None:
    done = run("--inputs", INPUTS, "--seed", SEED)
    assert done.returncode == 0, done.stdout + done.stderr
    rows = {words[0]: int(words[1]) for line in done.stdout.splitlines()[1:-1] for words in [line.split()]}
    assert len(rows) == 37
    assert sum(rows.values()) == pytest.approx(INPUTS, abs=20)


@pytest.mark.parametrize(("fault", "says"), [
    ("raise KeyError('bug')", "KeyError: 'bug'"),
    ("raise InputError('two\\nlines')", "several lines"),
    ("import os; os.abort()", "ends the process with -6"),
    ("global kept; kept = b'x' * 2**29", "MB, 300 are allowed"),
    ("import time; time.sleep(60)", "takes more than 10 s"),
])
def test_the_fuzzer_sees_what_it_looks_for(tmp_path: Path, fault: str, says: str) -> None:
    """A copy of it, with one target that has a bug at one input."""
    for path in FUZZ.parent.glob("*.py"):
        (tmp_path / path.name).write_bytes(path.read_bytes())
    (tmp_path / "fuzz_seeds.py").write_text(
        "from pathlib import Path\ndef read_seeds(path): return [b'seed']\n"
        "if __name__ == '__main__': import sys; Path(sys.argv[1], 'one.seeds').touch()\n", encoding="utf-8")
    (tmp_path / "fuzz_targets.py").write_text(
        "from types import SimpleNamespace\nfrom stab_ros.core.errors import InputError\nnumber = 0\n"
        "def read(data):\n    global number\n    number += 1\n    if number == 8:\n        fault()\n"
        f"def fault():\n    {fault}\n"
        "TARGETS = {'one': SimpleNamespace(read=read, share=1, tokens=())}\n", encoding="utf-8")
    done = subprocess.run([sys.executable, str(tmp_path / "fuzz.py"), "--inputs", "20"], capture_output=True, text=True,
                          check=False, timeout=120)
    assert done.returncode == 1, done.stdout + done.stderr
    assert says in done.stdout
    assert "again: fuzz.py --target one --seed 0 --first 7 --inputs 1" in done.stdout
