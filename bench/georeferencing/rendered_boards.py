"""A rendered survey with relief: how well the water all over the picture is placed by cameras known more or less.

    PYTHONPATH=.:test/helpers .venv/bin/python bench/georeferencing/rendered_boards.py

Control points are boards on the banks, 0.3 to 2.6 m above the water, marked in the picture by corner refinement
(`stab-ros camera` fits the same), or exact. The lens has 8 coefficients and bends by 8 % at the corners; the principal
point lies 0.5 % of the width off the middle.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from rendered_survey import RenderedSurvey

from stab_ros.core.errors import InputError
from stab_ros.georeferencing.camera_fit import CameraFit, fit_camera, fit_pose
from stab_ros.georeferencing.camera_problem import Unknowns
from stab_ros.georeferencing.control_points import ControlPoints
from stab_ros.synthetic.survey_scenes import NO_LENS, RATIONAL

Fit = Callable[[RenderedSurvey, ControlPoints], CameraFit]
WAYS: dict[str, Fit] = {
    "pose of a calibrated camera": lambda survey, points: fit_pose(points, survey.view.camera),
    "focal length too, lens and principal point known":
        lambda survey, points: fit_camera(points, survey.size, camera=survey.view.camera),
    "nothing known, focal length fitted": lambda survey, points: fit_camera(points, survey.size),
    "nothing known, focal length and k1 fitted":
        lambda survey, points: fit_camera(points, survey.size, Unknowns(k1=True)),
}


def row(survey: RenderedSurvey, way: Fit, marked: bool) -> str:
    """Median and largest error, m; "refused" where the points do not tell the camera."""
    try:
        off = survey.errors_m(way(survey, survey.control_points(marked)).view)
    except InputError:
        return "refused"
    return f"{np.median(off):.4f} / {np.nanmax(off):.4f}"


def main() -> None:
    """Prints the table."""
    print("| scene | camera | boards marked | exact pixels |\n|---|---|--:|--:|")
    for name, lens in (("nadir", NO_LENS), ("nadir", RATIONAL), ("oblique", RATIONAL)):
        survey = RenderedSurvey(name, lens)
        for title, way in WAYS.items():
            seen = f"{name}, {'no lens' if lens == NO_LENS else 'lens'}"
            print(f"| {seen} | {title} | {row(survey, way, True)} | {row(survey, way, False)} |")


if __name__ == "__main__":
    main()
