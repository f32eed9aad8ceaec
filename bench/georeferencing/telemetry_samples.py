"""Public telemetry read here and by others: DJI's subtitles against DJI_SRT_Parser, RTKLIB's solutions against `split`.

    git clone https://github.com/JuanIrache/DJI_SRT_Parser && npm install --prefix DJI_SRT_Parser
    git clone https://github.com/taroz/MatRTKLIB
    python bench/georeferencing/telemetry_samples.py DJI_SRT_Parser MatRTKLIB

Of every block or line: latitude, longitude, height and angles, to the last digit; the covariance to 1e-12. `only there`
counts blocks without a position in the file, for which DJI_SRT_Parser takes that of a neighbour; `mended`, covariances
that rounding in the file made none.
"""

from __future__ import annotations

import argparse
import json
import math
import subprocess
from collections.abc import Sequence
from datetime import datetime, timedelta, timezone
from pathlib import Path
from typing import Any

import numpy as np

from stab_ros.core.errors import InputError
from stab_ros.io.srt_telemetry import attitude_of
from stab_ros.io.telemetry import read_telemetry
from stab_ros.io.telemetry_record import Record

_PARSER = """
const parse = require(process.argv[1] + '/index.js'), fs = require('fs');
console.error = console.warn = () => {};
const out = {};
for (const file of process.argv.slice(2)) {
  const all = parse(fs.readFileSync(file).toString(), file);
  if (!all) continue;
  all.setSmoothing(0);
  out[file] = all.metadata().packets.map(p => ({time: p.TIMECODE, gps: p.GPS || {}, gimbal: p.G_PRY, body: p.F_PRY,
    height: [p.ALTITUDE, p.BAROMETER, p.HB].find(h => h != null)}));
}
console.log(JSON.stringify(out));
"""


def read(path: Path) -> list[Record]:
    """The records of a file; none where it is refused."""
    try:
        return read_telemetry(path, timezone.utc, lambda done, total: None).records
    except InputError:
        return []


def by_parser(repository: Path, files: Sequence[Path]) -> dict[str, list[dict[str, Any]]]:
    """What DJI_SRT_Parser makes of the files that it reads, one process each, as it may fail."""
    found: dict[str, list[dict[str, Any]]] = {}
    for file in files:
        done = subprocess.run(["node", "-e", _PARSER, str(repository.resolve()), str(file.resolve())],
                              capture_output=True, text=True, check=False)
        if done.returncode == 0:
            found[file.name] = json.loads(done.stdout).get(str(file.resolve()), [])
    return found


def time_ns(code: str) -> int:
    """Of a time code."""
    hours, minutes, seconds = code.split(":")
    whole, millis = seconds.split(",")
    return ((int(hours) * 60 + int(minutes)) * 60 + int(whole)) * 10**9 + int(millis) * 10**6


def same(record: Record, theirs: dict[str, Any]) -> bool:
    """Whether a block says the same; their angles are named by their place in roll, pitch, yaw."""
    place = (theirs["gps"].get("LATITUDE"), theirs["gps"].get("LONGITUDE"))
    heights = [height for height in (record.height_m, record.above_takeoff_m) if math.isfinite(height)]
    turns = ((record.gimbal, theirs.get("gimbal")), (record.body, theirs.get("body")))
    return (place == (record.latitude_deg, record.longitude_deg)
            and (theirs.get("height") is None or theirs["height"] in heights)
            and all(ours is None if turn is None else ours is not None and np.allclose(
                ours, attitude_of(turn["3"], turn["2"], turn["1"]), atol=1e-12) for ours, turn in turns))


def subtitles(repository: Path) -> None:
    """Prints the table of DJI_SRT_Parser's samples."""
    files = sorted(path for path in (repository / "samples").iterdir() if path.suffix.lower() == ".srt")
    theirs = by_parser(repository, files)
    print(f"{'subtitles':28}{'blocks there':>14}{'here':>8}{'same':>8}{'differ':>8}{'only there':>12}")
    for file in files:
        blocks, records = theirs.get(file.name, []), read(file)
        ours = {record.since_start_ns if record.since_start_ns is not None else number: record
                for number, record in reversed(list(enumerate(records)))}
        pairs = [(ours.get(number if block.get("time") is None else time_ns(block["time"])), block)
                 for number, block in enumerate(blocks)]
        both = [same(record, block) for record, block in pairs if record is not None]
        print(f"{file.name:28}{len(blocks):14}{len(records):8}{sum(both):8}{len(both) - sum(both):8}"
              f"{len(pairs) - len(both):12}")


def row_of(words: Sequence[str]) -> tuple[tuple[float, ...], int, np.ndarray]:
    """Place, UTC and covariance of a line of a solution with times of GPS."""
    if "/" in words[0]:
        shown = datetime.strptime(" ".join(words[:2]), "%Y/%m/%d %H:%M:%S.%f").replace(tzinfo=timezone.utc)
    else:
        shown = datetime(1980, 1, 6, tzinfo=timezone.utc) + timedelta(weeks=int(words[0]), seconds=float(words[1]))
    values = [float(word) for word in words[2:]]
    n, e, u, ne, eu, un = (math.copysign(value**2, value) for value in values[5:11])
    utc_ns = round((shown - timedelta(seconds=18)).timestamp() * 1000) * 10**6
    return tuple(values[:3]), utc_ns, np.array([[e, ne, eu], [ne, n, un], [eu, un, u]])


def solutions(repository: Path) -> None:
    """Prints the table of the solutions of a repository."""
    print(f"\n{'solutions':40}{'lines':>8}{'here':>8}{'same':>8}{'mended':>8}")
    for file in sorted(repository.rglob("*.pos")):
        lines = [line.split() for line in file.read_text().splitlines() if line.strip() and line[0] != "%"]
        records, equal, mended = read(file), 0, 0
        for record, words in zip(records, lines, strict=False):
            place, utc_ns, C = row_of(words)
            at_place = (record.latitude_deg, record.longitude_deg, record.height_m) == place and record.utc_ns == utc_ns
            known = record.covariance_m2 if record.covariance_m2 is not None else np.zeros((3, 3))
            mended += at_place and np.linalg.eigvalsh(C)[0] < 0
            equal += at_place and np.allclose(known, C, rtol=1e-12, atol=0)
        print(f"{file.relative_to(repository)!s:40}{len(lines):8}{len(records):8}{equal:8}{mended:8}")


def main() -> None:
    """Prints both tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("subtitles", type=Path, help="a clone of DJI_SRT_Parser, with its packages")
    parser.add_argument("solutions", type=Path, help="a clone of MatRTKLIB")
    options = parser.parse_args()
    subtitles(options.subtitles)
    solutions(options.solutions)


if __name__ == "__main__":
    main()
