"""Writes a synthetic survey as a recording, with its control points, checkpoints and truth.

    .venv/bin/python bench/georeferencing/record_survey.py level_strip FOLDER [--size 1360x765] [--frames 1251]
        [--seed 1] [--sensors ppk] [--attitude imu] [--color]

Surveys: nadir, oblique, strip, level_strip. Sensors: exact, ppk, consumer. gcps.csv and checkpoints.csv are of the
first frame, gcps_last.csv of the last.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "test" / "helpers"))

from survey_recording import write_checkpoints, write_gcps, write_recording, write_truth

from stab_ros.synthetic.geodetic import Origin
from stab_ros.synthetic.sensors import CONSUMER, EXACT, PPK
from stab_ros.synthetic.survey_flight import SurveyFlight
from stab_ros.synthetic.survey_scenes import SURVEYS, survey

SENSORS = {"exact": EXACT, "ppk": PPK, "consumer": CONSUMER}


def main() -> None:
    """Writes survey.mcap, gcps.csv, gcps_last.csv, checkpoints.csv and truth.csv."""
    given = _arguments()
    flight = SurveyFlight(survey(given.survey), given.size, given.frames, given.seed, given.color)
    given.folder.mkdir(parents=True, exist_ok=True)
    write_gcps(given.folder / "gcps.csv", flight)
    write_gcps(given.folder / "gcps_last.csv", flight, len(flight) - 1)
    write_checkpoints(given.folder / "checkpoints.csv", flight)
    write_truth(given.folder / "truth.csv", flight)
    write_recording(given.folder / "survey.mcap", flight, SENSORS[given.sensors], Origin(), given.seed, given.attitude)


def _size(text: str) -> tuple[int, int]:
    width, height = (int(number) for number in text.split("x"))
    return width, height


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("survey", choices=SURVEYS)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--size", type=_size)
    parser.add_argument("--frames", type=int)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--sensors", choices=SENSORS, default="ppk")
    parser.add_argument("--attitude", choices=("imu", "gimbal"), default="imu")
    parser.add_argument("--color", action="store_true")
    return parser.parse_args()


if __name__ == "__main__":
    main()
